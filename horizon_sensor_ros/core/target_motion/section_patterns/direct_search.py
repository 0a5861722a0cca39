"""Direct (pattern) search for the maximum of a function without derivatives, as paper D uses it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

_STARTS, _CLIMBS = 256, 6  # places that are looked at first, and the highest of them, climbed from
_SMALLEST = 1 / 128  # mesh of a climb at its end, over the first
_MOST_EVALUATIONS = 4000  # of a climb
_PLATEAU_SAMPLES = 1000
_PLATEAU_DEPTH = 0.005  # of values about as high as the highest


@dataclass(frozen=True, eq=False)
class SearchResult:
    """Where the search ended.

    best : (D,) the answer. top : (D,) place of the highest value seen; of ``direct_search`` the
    answer is the middle of the plateau around it. value : at ``top``. evaluations : how often the
    function was evaluated.
    """

    best: np.ndarray
    top: np.ndarray
    value: float
    evaluations: int


def compass_search(
    function: Callable[[np.ndarray], np.ndarray],
    start: np.ndarray,
    step: np.ndarray,
    smallest: float,
) -> SearchResult:
    """Poll both ways along every axis, move to the best, and halve the mesh where none is better.

    After a success the poll's direction is tried again as well, as far and twice as far (the
    pattern move).

    function : takes (C, D) places, returns (C,) values; a whole poll is one call. step : (D,) first
    mesh size. smallest : the search ends once the mesh has shrunk to this part of the first.
    """
    best = np.asarray(start, float)
    value = float(function(best[None])[0])
    evaluations, mesh = 1, 1.0
    axes = np.concatenate([np.eye(len(best)), -np.eye(len(best))]) * np.asarray(step, float)
    pattern = None
    while mesh >= smallest and evaluations < _MOST_EVALUATIONS:
        polls = best + mesh * axes
        if pattern is not None:
            polls = np.concatenate([polls, best + np.stack([pattern, 2 * pattern])])
        values = function(polls)
        evaluations += len(polls)
        top = int(np.argmax(values))
        if values[top] > value:
            pattern, best, value = polls[top] - best, polls[top], float(values[top])
            mesh = min(2 * mesh, 1.0)
        else:
            pattern, mesh = None, mesh / 2
    return SearchResult(best, best, value, evaluations)


def direct_search(
    function: Callable[[np.ndarray], np.ndarray],
    reach: np.ndarray,
    plateau: np.ndarray | None = None,
) -> SearchResult:
    """Compass searches from the best of an even spread of starts over the box +-``reach`` (D,),
    its centre among them; the answer is the middle of the plateau that the highest one reached.

    plateau : (D,) how far the plateau may reach to both sides, less than half a cell; None: the
        highest place alone is the answer.

    The paper asks for the arguments of the greatest value, but a likeness counted in cells has no
    single such place: it is a staircase with its steps where points happen to cross the borders of
    cells, and its highest step says less than the middle of those about as high.
    """
    from scipy.stats import qmc  # noqa: PLC0415  heavy to import, and only used here

    reach = np.asarray(reach, float)
    spread = qmc.Halton(len(reach), scramble=False).random(_STARTS)
    places = np.concatenate([np.zeros((1, len(reach))), (2 * spread - 1) * reach])
    values = function(places)
    order = np.argsort(-values, kind="stable")[:_CLIMBS]
    if 0 not in order:
        order[-1] = 0
    runs = [compass_search(function, places[k], reach / 4, _SMALLEST) for k in order]
    top = max(runs, key=lambda run: run.value)
    evaluations = len(places) + sum(run.evaluations for run in runs)
    if plateau is None:
        return SearchResult(top.top, top.top, top.value, evaluations)
    middle = plateau_mean(function, top.top, plateau, samples=_PLATEAU_SAMPLES)
    return SearchResult(middle, top.top, top.value, evaluations + 2 * _PLATEAU_SAMPLES)


def plateau_mean(
    function: Callable[[np.ndarray], np.ndarray],
    best: np.ndarray,
    reach: np.ndarray,
    samples: int,
) -> np.ndarray:
    """(D,) mean of the places around ``best`` whose values are about as high as the highest; looked
    for at so many samples within ``reach`` (D,) to both sides, twice.
    """
    from scipy.stats import qmc  # noqa: PLC0415  heavy to import, and only used here

    spread = (2 * qmc.Halton(len(best), scramble=False).random(samples) - 1) * np.asarray(reach)
    middle = np.asarray(best, float)
    for _ in range(2):
        places = middle + spread
        values = function(places)
        weight = np.exp((values - values.max()) / _PLATEAU_DEPTH)
        middle = weight @ places / weight.sum()
    return middle
