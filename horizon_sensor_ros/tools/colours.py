"""The colours of what commands draw, which colour-blind readers tell apart.

Okabe & Ito's, and Tol's purple.
"""

from __future__ import annotations

BLUE, VERMILION, GREEN, PURPLE, ORANGE = "#0072B2", "#D55E00", "#009E73", "#AA4499", "#E69F00"
COLOURS = (BLUE, VERMILION, GREEN, PURPLE, ORANGE)
