"""The package in one figure: which file does what, in the order of the data."""

from __future__ import annotations

from pathlib import Path

from matplotlib.axes import Axes

from figures.drawing import GREY, arrow, blank, box, save

_CORE, _ROS, _OTHER = "#DCEBF5", "#DDF1E9", "#FBE9D9"
# Each box: folder or file, and what it does. Top to bottom is the way of the data.
HORIZON = (
    ("core/camera.py", "pixels to rays, distortion"),
    ("core/limb/", "image to points of the limb"),
    ("core/fits/", "points to nadir, altitude"),
    ("core/covariance/", "how sure that is"),
    ("core/judgement.py", "believe it, or say why not"),
)
TARGET = (
    ("core/target/range_image.py", "cloud to a range image"),
    ("core/target/search.py", "many motions at once"),
    ("core/target/refinement.py", "the best one, refined"),
    ("core/target/judgement.py", "believe it, or say why not"),
    ("core/target/tracker.py", "steps to a track"),
)
ROS_IN = (("ros/messages.py", "images to numpy"), ("ros/point_cloud.py", "clouds to numpy"))
ROS_OUT = (
    ("ros/horizon_pipeline.py", "pairs frames, counts causes"),
    ("ros/target_pipeline.py", "the same for clouds"),
)
NODES = (("ros/horizon_node.py", "two nodes"), ("ros/target_node.py", "one node"))
TOOLS = (("tools/", "replay, report, demo, maps"), ("sim/", "scenes with truth"))


def draw(folder: Path) -> None:
    """Write architecture.png."""
    figure, axes = blank(6.5, 7.6)
    axes.text(1, 73.2, "horizon_sensor_ros/", fontsize=12, weight="bold")
    columns = (1.0, 33.5)
    for x, column in zip(columns, (HORIZON, TARGET), strict=True):
        first = 0 if column is HORIZON else 1
        y = _box(axes, x, 66, ROS_IN[first], _ROS)
        for entry in column:
            y = _box(axes, x, y - 2.2 - 5.4, entry, _CORE, above=y)
        y = _box(axes, x, y - 2.2 - 5.4, ROS_OUT[first], _ROS, above=y)
        y = _box(axes, x, y - 2.2 - 5.4, NODES[first], _ROS, above=y)
    for x, entry in zip(columns, TOOLS, strict=True):
        _box(axes, x, 5.0, entry, _OTHER)
    axes.text(
        1, 0.9, "Blue: NumPy, SciPy and OpenCV, without ROS. Green: ROS.\n"
        "tools/ runs the pipelines without nodes.",
        fontsize=9.5, color=GREY,
    )  # fmt: skip
    save(figure, folder / "architecture.png")


def _box(
    axes: Axes, x: float, y: float, entry: tuple[str, str], colour: str, above: float | None = None
) -> float:
    box(axes, (x, y), (30.5, 5.4), "\n".join(entry), colour)
    if above is not None:
        arrow(axes, (x + 15, above), (x + 15, y + 5.4))
    return y
