"""The benchmark of the target on a handful of clouds: its parts run, and its bars are the right
way round.
"""

from __future__ import annotations

import numpy as np
import pytest

pytestmark = pytest.mark.usefixtures("modules_of_the_benchmark")


def test_random_pairs_against_their_bars() -> None:
    from tables import Options
    from target.sets import COLD, RandomSet, acceptance_table, honesty_table, pairs_table

    one = RandomSet("n5", "n5", Options(2))
    one.measure()
    assert one.count == 3
    rows = {row[1]: row[3] for row in acceptance_table([one]).rows}
    assert rows["no success, %"] == "met (0.5)"
    # One that is off by more than allowed, and one that is refused.
    one.methods[COLD].deg[0] = 3.0
    one.methods[COLD].refused += 1
    rows = {row[1]: row[3] for row in acceptance_table([one]).rows}
    assert rows["no success, %"] == "MISSED (0.5)"
    assert one.methods[COLD].success == 0.5
    assert len(pairs_table([one]).rows) == len(one.methods)
    (honest,) = honesty_table([one]).rows
    assert honest[0] == "n5"


def test_peers_that_cannot_be_imported_are_named_with_the_reason() -> None:
    from target import peers

    assert {"small_gicp", "open3d"} >= set(peers.MISSING)
    assert all(why for why in peers.MISSING.values())
    assert bool(peers.PEERS) == (len(peers.MISSING) < 2)


def test_profile_names_the_parts_of_the_registration(monkeypatch: pytest.MonkeyPatch) -> None:
    from tables import Options
    from target import profile

    monkeypatch.setattr(profile, "PAIRS", 2)
    rows = profile.profile_table(Options(1)).rows
    for start in ("cold", "prior"):
        names = [row[1] for row in rows if row[0] == start]
        assert {"registration.register", "target_view.target_view"} <= set(names)


def test_latency_is_measured_over_the_real_node() -> None:
    from nodes import target_latency

    clouds = target_latency._organised()[:4]
    found = target_latency._measure(clouds, 6, "a few")
    assert found.sent == 6
    assert found.poses_s
    assert all(late > 0 for late in (*found.poses_s, *found.clouds_s))
    assert np.isfinite(found.node_cpu_s)
