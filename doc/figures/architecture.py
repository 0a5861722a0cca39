"""The package in one figure: which file does what, in the order of the data."""

from __future__ import annotations

from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.patches import FancyBboxPatch

from figures.drawing import GREY, arrow, blank, box, save

_CORE, _DRIVER, _ROS, _OTHER = "#DCEBF5", "#F1F7FB", "#DDF1E9", "#FBE9D9"
_WIDTH, _HEIGHT, _GAP = 30.5, 5.2, 2.0
# What drives the steps below it, and is where to start reading; then the steps, each a folder or
# file, or what is done, and what that is. Top to bottom is the way of the data.
HORIZON_DRIVER = ("core/horizon/sensor.py", "start here: follow or search the limb")
HORIZON = (
    ("core/horizon/search.py", "which cameras to search together"),
    ("core/limb/", "image to points of the limb"),
    ("core/horizon/estimator.py", "limbs to a fix, by these three:"),
    ("core/fits/", "points to nadir, altitude"),
    ("core/covariance/", "errors that points share, and all else"),
    ("core/horizon/judgement.py", "believe it, or say why not"),
)
TARGET_DRIVER = ("core/target_motion/tracker.py", "start here: clouds to a track")
TARGET = (
    ("core/target_motion/registration.py", "two clouds to a motion, by these:"),
    ("core/target_motion/ranges/", "cloud to a range image"),
    ("core/target_motion/noise/", "how exact it is"),
    ("core/target_motion/surfaces/", "image to planes and edges"),
    ("core/target_motion/alignment/", "search, pairs, refinement"),
    ("core/target_motion/judgement/", "believe it, or say why not"),
)
ROS_IN = (
    ("ros/messages/images.py", "images to numpy"),
    ("ros/messages/point_cloud.py", "clouds to numpy"),
)
ROS_OUT = (
    ("ros/pipelines/horizon_pipeline.py", "pairs frames, counts causes"),
    ("ros/pipelines/target_pipeline.py", "the same for clouds"),
)
NODES = (("ros/nodes/horizon_node.py", "two nodes"), ("ros/nodes/target_node.py", "one node"))
TOOLS = (("tools/", "replay, report, demo, maps"), ("sim/", "scenes with truth"))


def draw(folder: Path) -> None:
    """Write architecture.png."""
    figure, axes = blank(6.5, 8.6)
    axes.text(1, 83.2, "horizon_sensor_ros/", fontsize=12, weight="bold")
    columns = zip((1.0, 33.5), (HORIZON_DRIVER, TARGET_DRIVER), (HORIZON, TARGET), strict=True)
    for index, (x, driver, steps) in enumerate(columns):
        y = _box(axes, x, 76.2, ROS_IN[index], _ROS)
        y = _driver(axes, x, y, driver, steps)
        y = _box(axes, x, y - _GAP - _HEIGHT, ROS_OUT[index], _ROS, above=y)
        y = _box(axes, x, y - _GAP - _HEIGHT, NODES[index], _ROS, above=y)
        _box(axes, x, 5.0, TOOLS[index], _OTHER)
    axes.text(
        1, 0.9, "Blue: NumPy, SciPy and OpenCV, without ROS. Green: ROS.\n"
        "tools/ runs the pipelines without nodes.",
        fontsize=9.5, color=GREY,
    )  # fmt: skip
    save(figure, folder / "architecture.png")


def _driver(
    axes: Axes, x: float, top: float, driver: tuple[str, str], steps: tuple[tuple[str, str], ...]
) -> float:
    """Draw the steps inside a box of what calls them; return that box's lower edge."""
    upper = top - _GAP
    height = _HEIGHT + len(steps) * (_HEIGHT + _GAP) - _GAP + 1.0
    lower = upper - height
    axes.add_patch(
        FancyBboxPatch(
            (x, lower), _WIDTH, height, "round,pad=0,rounding_size=0.8",
            facecolor=_DRIVER, edgecolor="0.25",
        )
    )  # fmt: skip
    middle = x + _WIDTH / 2
    axes.text(middle, upper - 1.5, driver[0], ha="center", va="center", fontsize=10, weight="bold")
    axes.text(middle, upper - 3.5, driver[1], ha="center", va="center", fontsize=9)
    arrow(axes, (middle, top), (middle, upper))
    y, above = upper - _HEIGHT, None
    for entry in steps:
        y = _box(axes, x + 1, y - _HEIGHT, entry, _CORE, above=above, width=_WIDTH - 2)
        above, y = y, y - _GAP
    return lower


def _box(
    axes: Axes,
    x: float,
    y: float,
    entry: tuple[str, str],
    colour: str,
    above: float | None = None,
    width: float = _WIDTH,
) -> float:
    box(axes, (x, y), (width, _HEIGHT), "\n".join(entry), colour)
    if above is not None:
        arrow(axes, (x + width / 2, above), (x + width / 2, y + _HEIGHT))
    return y
