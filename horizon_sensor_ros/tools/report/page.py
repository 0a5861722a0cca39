"""The report put together: sections in order, one HTML file with everything inside it."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import jinja2
import numpy as np

from horizon_sensor_ros.core.seconds import s_from_ns
from horizon_sensor_ros.ros.parameters.horizon_settings import HorizonSettings
from horizon_sensor_ros.ros.parameters.parameter import ParameterError
from horizon_sensor_ros.tools.bags.replayed_node import TopicNames
from horizon_sensor_ros.tools.command_errors import CommandError
from horizon_sensor_ros.tools.horizon_parameters import (
    base_frame_in,
    horizon_values,
    settings_of_a_node,
)
from horizon_sensor_ros.tools.output_files import written_whole
from horizon_sensor_ros.tools.report.attitude import attitude_section, attitudes
from horizon_sensor_ros.tools.report.bags import read_bags
from horizon_sensor_ros.tools.report.blocks import Section
from horizon_sensor_ros.tools.report.errors import horizon_errors_section, target_errors_section
from horizon_sensor_ros.tools.report.frames import look_again
from horizon_sensor_ros.tools.report.imu import imu_section
from horizon_sensor_ros.tools.report.overview import availability, contents, latency
from horizon_sensor_ros.tools.report.recorded import Recorded
from horizon_sensor_ros.tools.report.residuals import refusal_blocks, residuals_section
from horizon_sensor_ros.tools.report.target import target_section

_NUMBER = re.compile(r"[-+]?[\d.,]+(e[-+]?\d+)?( %)?|-|nan")
# From here on who compares /diagnostics with the frames has to know of it.
_LATE_S = 1.0


def write_page(
    bags: Sequence[Path],
    path: Path,
    *,
    params: Path | None = None,
    namespace: str = "/",
    remappings: Sequence[str] = (),
    imu_topic: str | None = None,
    title: str | None = None,
    stopped: Callable[[], bool] = bool,
) -> None:
    """Write the report of what is in one or more bags; see `report.write_report`."""
    names = TopicNames(namespace, remappings)
    values = _parameter_values(params, namespace)
    recorded = read_bags(bags, names, imu_topic, stopped)
    # Who looks at a target has no cameras to tell of.
    settings = _pipeline_settings(values) if recorded.frames else None
    again = look_again(recorded, settings, names, stopped)
    blocks = (*refusal_blocks(recorded), *again.refused)
    refused = Section("refused", "Why there was no answer", blocks)
    sections = (
        availability(recorded),
        horizon_errors_section(recorded),
        again.answered,
        attitude_section(recorded),
        imu_section(recorded, base_frame_in(values or [])),
        residuals_section(recorded, again.residuals),
        again.agreement,
        refused,
        target_section(recorded, names, bags, stopped),
        target_errors_section(recorded),
        latency(recorded),
        contents(recorded),
    )
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("horizon_sensor_ros.tools.report"), autoescape=True
    )
    environment.tests["a_number"] = lambda cell: _NUMBER.fullmatch(cell) is not None
    page = environment.get_template("report.html.j2").render(
        title=title or f"Horizon sensor: {bags[0].name}",
        lead=_lead(recorded),
        facts=_facts(recorded),
        sections=[section for section in sections if section is not None],
    )
    with written_whole(path) as (fresh,):
        # Of paths that are no UTF-8.
        fresh.write_text(page, encoding="utf-8", errors="backslashreplace")


def _parameter_values(params: Path | None, namespace: str) -> list[dict[str, Any]] | None:
    """What a parameter file has for each of the horizon's nodes; None without one. CommandError
    says what is wrong with it.
    """
    if params is None:
        return None
    try:
        return horizon_values(params, namespace)
    except ParameterError as error:
        raise CommandError(str(error)) from None


def _pipeline_settings(values: Sequence[Mapping[str, Any]] | None) -> HorizonSettings | None:
    """Settings of such values; None without any. CommandError says what is wrong with them."""
    if values is None:
        return None
    try:
        return settings_of_a_node(values)
    except ParameterError as error:
        raise CommandError(str(error)) from None


def _lead(recorded: Recorded) -> str:
    bags = " and ".join(path.name for path in recorded.bags)
    lead = f"From {bags}. Times count from stamp {s_from_ns(recorded.start_ns):.3f} s."
    late_s = [
        s_from_ns(received - stamp)
        for each in (recorded.frames_received_ns, recorded.clouds_received_ns)
        for stamp, received in each.items()
    ]
    if not recorded.diagnostics or max(map(abs, late_s), default=0.0) < _LATE_S:
        return lead
    return (
        f"{lead} Those of /diagnostics are when it was recorded, by a clock that was "
        f"{min(late_s):.1f} to {max(late_s):.1f} s ahead of the frames' stamps."
    )


def _facts(recorded: Recorded) -> list[tuple[str, str]]:
    """Return the figures that stand on top."""
    facts = []
    stamps = [s for each in (*recorded.answers.values(), *recorded.frames.values()) for s in each]
    stamps += recorded.clouds
    if stamps:
        facts.append(("length", f"{s_from_ns(max(stamps) - min(stamps)):.1f} s"))
    sets = len(recorded.camera_sets())
    found = attitudes(recorded)
    if sets:
        answers = len(
            recorded.answers.get("attitude") or recorded.answers.get("local_vertical", {})
        )
        facts.append(("frame sets answered", f"{answers} of {sets}"))
    if found is not None:
        sigma_deg = np.degrees(np.median(found.nadir_sigma_rad))
        facts.append(("nadir, median sigma", f"{sigma_deg:.3g} deg"))
        low, high = found.altitude_m.min() / 1e3, found.altitude_m.max() / 1e3
        facts.append(("altitude", f"{low:.0f} to {high:.0f} km"))
    poses = len(recorded.answers.get("target/pose", {}))
    if poses:
        of = f" of {len(recorded.clouds)}" if recorded.clouds else ""
        facts.append(("target poses", f"{poses}{of}"))
    return facts
