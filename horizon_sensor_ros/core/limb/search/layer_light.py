"""How light fades behind an edge: as in a layer of airglow, in air over a dark sea, or at dawn."""

from __future__ import annotations

import numpy as np

from horizon_sensor_ros.core.limb.search.columns import CREST_M, DEPTHS_M
from horizon_sensor_ros.core.mathematics.robust import median, quantile

# Behind its crest a layer fades in all columns alike.
_FADES_M = 25e3, 70e3  # depths between which it does
_FADES_AT_LEAST_M = 50e3  # instead of the second, where the ground's light begins before that
_FADED = 0.85  # brightness at the deeper one over that at the other, at most
ALIKE = 0.14  # of the crest, by which a column may differ from the median one
MOST = 0.6  # of the columns, that must not
# A thin shell that emits is seen through the longer, the nearer to its edge: brightness goes with
# one over the root of the depth, from the first of these on, so well as this where it is a layer's,
# down to where the planet hides the rear half of the shell, by the last of them for sure.
_SHELL_M = 36e3, 78e3, 108e3
ABOVE_GROUND_M = 60e3  # instead of the second, where ground shows behind, whose light begins there
_SHELL_LAW = 0.1
# Of what that law would have behind, in columns of which so large a share have less: air on the
# ground shows all of it. Lights on the ground may hide it in others.
_REAR_HIDDEN, _DARK_COLUMNS = 0.7, 0.25
# Brightness at that depth, above the edge, over the crest, which by night tells a shell:
# .11 and less above 80 simulated layers, .17 and more in air over 74 dark seas.
_ABOVE_M, _ENDS = -6e3, 0.14
# Behind a layer brightness falls short of that law, as it is down to the first depth, somewhere
# between the others: thick air takes its light, and the ground hides its rear. By at least this in
# photographs, .07 to .45, and .11 where ground deep below the edge is brighter than so much of the
# crest; in air over dark seas, simulated in two ways, by .07 at most, over so dark ones by .03.
_ABOVE_AIR_M, _BEHIND_M = 66e3, (72e3, 108e3)
_SHORT, _SHORT_OVER_DARK, _DARK = 0.09, 0.05, 0.3
# Where it does not: no less of the law than that, or ground that is so bright is never a layer's.
# Layers alone have .12 to .37, and a dark sea by day may be as dark.
_SHOWN, _LIT = 0.97, 0.38
# Beside the dawn air is lit above ground that is not: a bright band, which is thinner the farther
# it is from the Sun. Wedges of cloud beside the limb, which end nearer to the edge or less evenly,
# are like it in one of 500 frames.
_BAND_ENDS = 0.75  # of the crest: darker than this, a column is below the band
_BAND_M = 33e3, 84e3  # depth of its end where it is thinnest, more than; and thickest, more than
_NARROWS = 0.95  # rank correlation of that depth with the place along the limb, more than
_GROUND = 0.6  # brightness of dark ground over the crest's, at most
_DARK_SHARE = 0.5  # of the columns, behind which ground must be dark
_LEAST_COLUMNS = 7  # with dark ground, likewise
_LEAST_CREST = 1e-3  # gray levels: space may be as bright as the brightest of a column
_REAR = (_BEHIND_M[0] <= DEPTHS_M) & (_BEHIND_M[1] >= DEPTHS_M)


def _over_crest(level: np.ndarray, crest: np.ndarray) -> np.ndarray:
    """Brightness (N, D) over the columns' crests (N,); beside one without light all is bright."""
    return np.asarray(level / np.maximum(crest, _LEAST_CREST)[:, None])


def fades_alike(level: np.ndarray, crest: np.ndarray, at_trough: np.ndarray) -> bool:
    """Whether columns (N, D) fade behind their crests (N,) as a layer does, as far as their
    troughs: where pixels are coarse the light of the ground begins there.
    """
    last_m = max(_FADES_AT_LEAST_M, min(_FADES_M[1], median(DEPTHS_M[at_trough])))
    band = _over_crest(level, crest)[:, (_FADES_M[0] <= DEPTHS_M) & (last_m >= DEPTHS_M)]
    usual = np.median(band, axis=0)
    alike = np.abs(band - usual).max(axis=1) < ALIKE
    return bool(usual[-1] < _FADED * usual[0] and alike.mean() > MOST)


def fades_as_a_shell(
    level: np.ndarray, crest: np.ndarray, last_m: float = _SHELL_M[1]
) -> float | None:
    """Brightness, over the crest's, times the root of the depth (m) where columns (N, D) with these
    crests (N,) fade as a thin shell does, down to a depth; None where they do not.
    """
    front = (_SHELL_M[0] <= DEPTHS_M) & (last_m >= DEPTHS_M)
    usual = np.median(_over_crest(level[:, front], crest), axis=0) * np.sqrt(DEPTHS_M[front])
    law = median(usual)
    return law if np.abs(usual - law).max() < _SHELL_LAW * law else None


def is_shell(level: np.ndarray, crest: np.ndarray) -> bool:
    """Whether columns (N, D) with these crests (N,) fade as a thin shell does high above a planet
    that hides its rear half: an exposure for the night, whether or not it shows stars.
    """
    law = fades_as_a_shell(level, crest)
    if law is None:
        return False
    behind = _SHELL_M[2] <= DEPTHS_M
    each = _over_crest(level[:, behind], crest) * np.sqrt(DEPTHS_M[behind])
    return quantile(np.median(each, axis=1), _DARK_COLUMNS) < _REAR_HIDDEN * law


def ends_above(level: np.ndarray, crest: np.ndarray) -> bool:
    """Whether columns (N, D) with these crests (N,) fade as a thin shell does, but are darker above
    their edges than the Earth's air could be.
    """
    above = np.median(_over_crest(level[:, DEPTHS_M == _ABOVE_M], crest))
    return bool(above < _ENDS) and fades_as_a_shell(level, crest) is not None


def falls_short(level: np.ndarray, crest: np.ndarray) -> bool:
    """Whether brightness in columns (N, D) with these crests (N,) falls short behind the edge of
    what shows above, as it does in no air on the ground.
    """
    over_law = _over_the_law(level, crest)
    above = (_SHELL_M[0] <= DEPTHS_M) & (_ABOVE_AIR_M >= DEPTHS_M)
    slope, at_air = np.polyfit(DEPTHS_M[above] - _ABOVE_AIR_M, over_law[above], 1)
    expected = at_air + min(slope, 0.0) * (DEPTHS_M - _ABOVE_AIR_M)
    smooth = np.convolve(over_law, np.full(3, 1.0 / 3.0), mode="same")
    enough = _SHORT if _ground_over_crest(level, crest) > _DARK else _SHORT_OVER_DARK
    return bool((expected - smooth)[_REAR].max() > enough)


def is_air(level: np.ndarray, crest: np.ndarray) -> bool:
    """Whether ground deep below shows in columns (N, D) with these crests (N,) as it does through
    air by day, or none of the light of air on the ground lacks.
    """
    shown = _over_the_law(level, crest)[_REAR].min() > _SHOWN
    return bool(shown) or _ground_over_crest(level, crest) > _LIT


def _ground_over_crest(level: np.ndarray, crest: np.ndarray) -> float:
    """Brightness of the ground deep below the edge in columns (N, D), over their crests' (N,)."""
    return median(_over_crest(level[:, -3:], crest).mean(axis=1))


def _over_the_law(level: np.ndarray, crest: np.ndarray) -> np.ndarray:
    """Brightness (D,) of columns (N, D) with these crests (N,), over that of a thin shell which is
    as bright above the ground.
    """
    usual = np.median(_over_crest(level, crest), axis=0) * np.sqrt(np.maximum(DEPTHS_M, 0.0))
    front = (_SHELL_M[0] <= DEPTHS_M) & (ABOVE_GROUND_M >= DEPTHS_M)
    # Where next to nothing shows above, by a hundredth of the crest.
    return np.asarray(usual / max(float(np.median(usual[front])), 0.01 * np.sqrt(ABOVE_GROUND_M)))


def is_twilight(rays: np.ndarray, level: np.ndarray, nadir: np.ndarray) -> bool:
    """Whether columns (N, D) of one camera, at rays (N, 3), are of air that is lit above dark
    ground, the less of it the farther from the Sun.
    """
    crest = np.where(DEPTHS_M <= CREST_M, level, -np.inf).max(axis=1)
    dark = np.median(level[:, -3:], axis=1) < _GROUND * crest
    if np.count_nonzero(dark) < max(_DARK_SHARE * len(level), _LEAST_COLUMNS):
        return False
    rays, level, crest = rays[dark], level[dark], crest[dark, None]
    ends = np.maximum.accumulate(level >= crest, axis=1) & (level < _BAND_ENDS * crest)
    thick_m = DEPTHS_M[ends.argmax(axis=1)]
    along = rays @ np.cross(nadir, rays.mean(axis=0))
    in_band = _BAND_M[0] < thick_m.min() and thick_m.max() > _BAND_M[1]
    return bool(in_band and abs(_rank_correlation(along, thick_m)) > _NARROWS)


def _rank_correlation(a: np.ndarray, b: np.ndarray) -> float:
    """Correlation of the ranks of (N,) and (N,); ties by their order."""
    first, second = (np.argsort(np.argsort(values)) for values in (a, b))
    return float(np.corrcoef(first, second)[0, 1])
