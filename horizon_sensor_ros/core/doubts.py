"""Cameras that contradicted others, and for how long none of them is believed alone."""

from __future__ import annotations

from horizon_sensor_ros.core.horizon_fix import HorizonFix

_NO_CHANCE = 3  # sets of a contradiction from which on it is not one hard sky's
_LONGEST = 600  # sets that count: what it came from may have gone with the camera's view


class Doubts:
    """Remembers from set to set which cameras see a limb where others do not.

    Nothing tells which of two cameras that contradict each other is mounted as it should be; where
    the other one is dazzled for a moment this one alone would be believed. It is not for about as
    many sets as they contradicted each other, `_LONGEST` at most, unless they come to agree before.
    """

    def __init__(self) -> None:
        self._sets: dict[str, int] = {}

    def reset(self) -> None:
        """Forget all of them."""
        self._sets.clear()

    def against(self, fix: HorizonFix, *, followed: bool) -> str:
        """Why the fix of a set is not believed: it is a doubted camera's alone; empty where it is.

        followed : the limb was not searched for, so that who was left out was not asked again.
        """
        alone = len(fix.cameras_used) == 1 and not fix.cameras_spared
        doubted = self._sets.get(fix.cameras_used[0], 0) if alone else 0
        self._remember(fix, followed)
        if doubted < _NO_CHANCE:
            return ""
        return (
            f"{fix.cameras_used[0]} alone sees a limb, and contradicted other cameras before: not "
            f"believed for another {doubted - _NO_CHANCE + 1} sets, unless they agree"
        )

    def _remember(self, fix: HorizonFix, followed: bool) -> None:
        for name in fix.contradicting:
            self._sets[name] = self._sets.get(name, 0) + 1
        together = {*fix.cameras_used, *fix.cameras_spared}
        for name in [name for name in self._sets if name not in fix.contradicting]:
            if len(together) > 1 and name in together:
                # What is less certain for a contradiction does not settle it.
                self._sets[name] = self._sets[name] if fix.reason else 0
            else:
                self._sets[name] += 1 if followed else -1
        self._sets = {name: min(sets, _LONGEST) for name, sets in self._sets.items() if sets > 0}
