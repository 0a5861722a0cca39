"""Cameras that contradicted others, and for how long none of them is believed alone."""

from __future__ import annotations

from horizon_sensor_ros.core.horizon.fix import HorizonFix

_NO_CHANCE = 3  # sets of a contradiction from which on it is not one hard sky's
_AGREEMENTS = 3  # sets one after the other that settle a contradiction
_LONGEST = 600  # sets that count: what it came from may have gone with the camera's view


class Doubts:
    """Remembers from set to set which cameras see a limb where others do not.

    Nothing tells which of two cameras that contradict each other is mounted as it should be. Where
    one is dazzled for a moment the other alone would be believed. It is not, for as many of its
    own fixes as there were contradictions, `_LONGEST` at most, unless the cameras come to agree
    before. Cameras of a wrong focal length agree by chance, now and then, on a limb in between: to
    agree is to do so in `_AGREEMENTS` sets one after the other.
    """

    def __init__(self) -> None:
        self._sets: dict[str, int] = {}
        self._agreed = 0

    def against(self, fix: HorizonFix, *, followed: bool) -> str:
        """Why the fix of a set is not believed: it is a doubted camera's alone, or one of
        doubted cameras that have not agreed for long enough; empty where it is.

        followed : the limb was not searched for, so that who was left out was not asked again.
        """
        together = [*fix.cameras_used, *fix.cameras_spared] if fix.ok else []
        alone = len(together) == 1
        doubted = max((self._sets.get(name, 0) for name in together), default=0)
        agree = doubted >= _NO_CHANCE and not alone and not fix.reason
        self._agreed = self._agreed + 1 if agree else 0
        self._remember(fix, together, followed)
        if doubted < _NO_CHANCE or self._agreed == _AGREEMENTS:
            return ""
        if not alone:
            return (
                f"{' and '.join(together)} contradicted each other before: not believed until they "
                f"agree in {_AGREEMENTS} sets one after the other"
            )
        return (
            f"{fix.cameras_used[0]} alone sees a limb, and contradicted other cameras before: not "
            f"believed for another {doubted - _NO_CHANCE + 1} sets, unless they agree"
        )

    def _remember(self, fix: HorizonFix, together: list[str], followed: bool) -> None:
        for name in fix.contradicting:
            self._sets[name] = self._sets.get(name, 0) + 1
        for name in [name for name in self._sets if name not in fix.contradicting]:
            if len(together) > 1 and name in together:
                # What is less certain for a contradiction does not settle it.
                settled = self._sets[name] < _NO_CHANCE or self._agreed == _AGREEMENTS
                if settled and not fix.reason:
                    self._sets[name] = 0
            elif fix.ok:
                self._sets[name] += 1 if followed else -1
        self._sets = {name: min(sets, _LONGEST) for name, sets in self._sets.items() if sets > 0}
