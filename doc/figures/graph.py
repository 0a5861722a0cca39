"""The ROS graph: nodes, topics, and the frames that the messages are in."""

from __future__ import annotations

from pathlib import Path

from matplotlib.axes import Axes

from figures.drawing import GREY, arrow, blank, box, save

_SENSOR, _NODE, _RESULT, _OPTION = "#FBE9D9", "#DCEBF5", "#DDF1E9", "white"
_SMALL = 9.5
# Lower left corner, size, text and colour.
_SENSORS = (
    (1, 46, 19, 11, "camera_N/image_raw\ncamera_N/camera_info\n(one to many cameras)", _SENSOR),
    (1, 38, 19, 5, "coarse_pose  (optional)\nin earth (ECEF)", _OPTION),
    (1, 31, 19, 5, "imu  (optional)\nin base_link", _OPTION),
    (1, 14, 19, 7, "target/points\nin the sensor's frame", _SENSOR),
)
_NODES = (
    (24.5, 48, 16, 7, "local_vertical_node", _NODE),
    (24.5, 36, 16, 7, "attitude_node", _NODE),
    (24.5, 14, 16, 7, "target_pose_node", _NODE),
)
_RESULTS = (
    (45, 48, 19, 7, "local_vertical\nVector3, in base_link:\ntowards the planet", _RESULT),
    (
        45,
        35.5,
        19,
        8,
        "attitude\npose in local_level:\nroll, pitch, altitude,\ncovariance",
        _RESULT,
    ),
    (45, 22.8, 19, 5.2, "target/pose\nin the sensor's frame", _RESULT),
    (45, 14.9, 19, 5.2, "target/pose_delta\nin target_previous", _RESULT),
    (45, 7, 19, 5.2, "target/twist\nin target_previous", _RESULT),
)


def draw(folder: Path) -> None:
    """Write graph.png."""
    figure, axes = blank(6.5, 6.3)
    _column(axes, 1, "in")
    _column(axes, 24.5, "nodes")
    _column(axes, 45, "out")
    for x, y, width, height, text, colour in (*_SENSORS, *_RESULTS):
        box(axes, (x, y), (width, height), text, colour, _SMALL)
    for x, y, width, height, text, colour in _NODES:
        box(axes, (x, y), (width, height), text, colour)
    for y in (51.5, 39.5):
        arrow(axes, (20, 51.5), (24.5, y))
        for source in (40.5, 33.5):
            arrow(axes, (20, source), (24.5, y), GREY, width=0.8)
        arrow(axes, (40.5, y), (45, y))
    arrow(axes, (20, 17.5), (24.5, 17.5))
    for y in (25.4, 17.5, 9.6):
        arrow(axes, (40.5, 17.5), (45, y))
    watched = "both also:\n~/debug_image\n(while watched)"
    axes.text(24.5, 29.2, watched, fontsize=_SMALL, color=GREY, va="center")
    note = "All publish /diagnostics. Thin: optional. Outputs have the stamp of their input."
    axes.text(1, 2.7, note, fontsize=_SMALL, color="0.25")
    save(figure, folder / "graph.png")


def _column(axes: Axes, x: float, title: str) -> None:
    axes.text(x, 59.5, title, fontsize=12, weight="bold")
