"""Paper B's model figure as a part of the benchmark; measured by `paper_b`."""

from __future__ import annotations

import numpy as np
import paper_b
from tables import Options, Text, verdict

from horizon_sensor_ros.core.horizon_config import HorizonConfig

BAR_DEG = 0.005
_STEP_DEG, _COARSE_STEP_DEG = 6.0, 30.0


def run(options: Options) -> list[Text]:
    """One table over the field of applicability; a coarse grid where few frames are asked for."""
    step_deg = _STEP_DEG if options.frames >= 100 else _COARSE_STEP_DEG
    result = paper_b.measure(step_deg)
    default = HorizonConfig().method
    errors = result.frames_deg[default]
    rms = paper_b.rms(errors)
    lines = [
        paper_b.table(result, default),
        f"Grid of {step_deg:g} deg. {default} (default), RMS over its "
        f"{int(np.isfinite(errors).sum())} fixes: {verdict(rms, BAR_DEG)}",
    ]
    return [Text("Paper B: error over the field of applicability", "\n".join(lines))]
