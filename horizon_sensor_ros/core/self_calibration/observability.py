"""Which directions of the unknowns the frames tell, and the others in words."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from horizon_sensor_ros.core.self_calibration.unknowns import Unknowns

# A motion with this share of its length among what is not observed is named as a whole.
_SHARE = 0.97
# Shorter than this outside what has been named already, it adds nothing.
_LEAST_NEW = 0.3
_LEAST_PART = 0.3


def observed_directions(information: np.ndarray, max_sigma: float) -> tuple[np.ndarray, np.ndarray]:
    """Eigenvalues (K,) and directions (P, K) that are observed.

    information : (P, P) on unknowns in natural units. Observed is what has at most max_sigma.
    """
    values, vectors = np.linalg.eigh(information)
    seen = values > max_sigma**-2
    return values[seen], vectors[:, seen]


def unobserved_in_words(
    unknowns: Unknowns,
    unobserved: np.ndarray,
    nadirs_base: np.ndarray,
    *,
    held: str,
    has_altitude: bool,
    has_reference: bool,
) -> tuple[str, ...]:
    """Name what is not observed, a sentence each.

    unobserved : (P, K) orthonormal directions of all unknowns in natural units. nadirs_base :
    (T, 3) of the frame sets. held : the camera that is taken as it is where nothing tells of all
    together. has_altitude, has_reference : whether these were given.
    """
    sentences: dict[str, None] = {}
    rest = unobserved
    given = {"has_altitude": has_altitude, "has_reference": has_reference}
    for sentence, motions in _motions(unknowns, nadirs_base, held, **given):
        left = rest
        for motion in motions:
            shorter = _without(left, unobserved, motion / unknowns.scales)
            if shorter is None:
                break
            left = shorter
        else:
            if left.shape[1] < rest.shape[1]:
                sentences[sentence] = None
            rest = left
    sentences.update(dict.fromkeys(_mixture(unknowns, rest[:, i]) for i in range(rest.shape[1])))
    return tuple(sentences)


def _without(rest: np.ndarray, unobserved: np.ndarray, motion: np.ndarray) -> np.ndarray | None:
    """What of `rest` remains when a motion is named; None if the motion is not all unobserved.

    rest : (P, K) of what is unobserved and not named yet.
    """
    direction = motion / np.linalg.norm(motion)
    if np.linalg.norm(unobserved.T @ direction) < _SHARE:
        return None
    inside = rest.T @ direction
    if np.linalg.norm(inside) < _LEAST_NEW:
        return rest
    basis = np.linalg.svd(inside[None, :])[2]
    return rest @ basis[1:].T


def _motions(
    unknowns: Unknowns,
    nadirs_base: np.ndarray,
    held: str,
    *,
    has_altitude: bool,
    has_reference: bool,
) -> Iterator[tuple[str, list[np.ndarray]]]:
    """Sentences, and what all must be unobserved for each to hold, the most common first."""
    cameras = unknowns.cameras
    middle = nadirs_base.mean(axis=0)
    middle /= np.linalg.norm(middle)
    spread = np.degrees(np.arccos(np.clip((nadirs_base @ middle).min(), -1.0, 1.0)))
    # Adding zero makes of -0.00 a 0.00.
    about = "({:.2f}, {:.2f}, {:.2f})".format(*(np.round(middle, 2) + 0.0))
    why = f"nadir stayed within {spread:.1f} deg of it"
    together = "how all cameras together sit in the base frame:"
    yield (
        f"{together} the reference is not sure enough"
        if has_reference
        else f"{together} the limb shows how they sit to each other; {held} is taken as it is",
        [unknowns.vector("rotation", cameras, axis) for axis in np.eye(3)],
    )
    if unknowns.drift:
        yield (
            f"a drift that all cameras share: {held} is taken as steady",
            [unknowns.vector("drift", cameras, axis) for axis in np.eye(3)],
        )
    height = unknowns.where("limb_height")
    yield (
        "limb height: the altitude, or the angle between limb and nadir, is not sure enough"
        if has_altitude
        else "limb height: it needs the altitude from elsewhere",
        [_unit(len(unknowns), height[0])],
    )
    for camera in (*(c for c in cameras if c != held), held):
        yield (
            f"{camera} about base axis {about}, the vertical: {why}",
            [unknowns.vector("rotation", [camera], middle)],
        )
        if unknowns.drift:
            yield (
                f"drift of {camera} about base axis {about}, the vertical: {why}",
                [unknowns.vector("drift", [camera], middle)],
            )
    for index, unknown in enumerate(unknowns.all):
        yield unknown.name, [_unit(len(unknowns), index)]


def _mixture(unknowns: Unknowns, direction: np.ndarray) -> str:
    """What a direction that has no name of its own is made of."""
    parts = np.flatnonzero(np.abs(direction) > _LEAST_PART)
    names = [unknowns.all[i].name for i in parts] or [
        unknowns.all[int(np.argmax(np.abs(direction)))].name
    ]
    return f"{' against '.join(names)}: only together" if len(names) > 1 else names[0]


def _unit(size: int, index: int) -> np.ndarray:
    out = np.zeros(size)
    out[index] = 1.0
    return out
