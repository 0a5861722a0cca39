"""Pairing: what makes a set, whatever way the streams arrive."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from horizon_sensor_ros.ros.pipelines.pairing import Pairing

MS = 1_000_000
SLOP = 20 * MS


def feed(pairing: Pairing, *frames: tuple[str, int]) -> list[tuple[int, ...]]:
    """Push frames (camera, stamp); return the stamps of the sets in the order they came."""
    sets = []
    for camera, stamp in frames:
        for members in pairing.push(camera, stamp, (camera, stamp)).sets:
            assert [item for _, item in members] == [
                (name, stamp) for name, (stamp, _) in zip("abc", members, strict=False)
            ]
            sets.append(tuple(stamp for stamp, _ in members))
    return sets


def pairing_of(cameras: str = "ab", slop: int = SLOP, depth: int = 10) -> Pairing:
    return Pairing(list(cameras), slop, depth)


def test_one_camera_needs_no_partner() -> None:
    assert feed(pairing_of("a"), ("a", 0), ("a", 5)) == [(0,), (5,)]


def test_the_first_pair_comes_at_once() -> None:
    assert feed(pairing_of(), ("b", 15 * MS), ("a", 0)) == [(0, 15 * MS)]


def test_stamps_farther_apart_than_slop_do_not_pair() -> None:
    pairing = pairing_of()
    assert feed(pairing, ("a", 0), ("b", SLOP + 1), ("a", 2 * SLOP)) == [(2 * SLOP, SLOP + 1)]


def test_stamps_just_as_far_apart_as_slop_pair() -> None:
    assert feed(pairing_of(), ("a", 0), ("b", SLOP)) == [(0, SLOP)]
    assert feed(pairing_of(slop=0), ("a", 7), ("b", 7)) == [(7, 7)]


def test_how_near_the_stamps_come_is_told() -> None:
    pairing = pairing_of("abc")
    assert pairing.nearest_ns("a") is None
    pairing.push("a", 100 * MS, None)
    assert pairing.nearest_ns("a") is pairing.nearest_ns("b") is None
    pairing.push("b", 130 * MS, None)
    pairing.push("c", 190 * MS, None)
    assert [pairing.nearest_ns(camera) for camera in "abc"] == [30 * MS, 30 * MS, 60 * MS]
    assert pairing_of("a").nearest_ns("a") is None


def test_a_lost_frame_does_not_shift_the_pairs_after_it() -> None:
    # At 60 Hz the slop is longer than the period: the next best partner would do, but is not best.
    stamps = [round(i * 1e9 / 60) for i in range(8)]
    frames = [(c, s) for s in stamps for c in "ab" if (c, s) != ("a", stamps[3])]
    sets = feed(pairing_of(), *frames)
    assert sets == [(s, s) for s in stamps if s != stamps[3]]


def test_a_repeated_stamp_is_dropped_and_said() -> None:
    pairing = pairing_of()
    pairing.push("a", 7, None)
    assert pairing.push("a", 7, None).repeated
    assert len(pairing.push("b", 7, None).sets) == 1
    assert pairing.push("b", 7, None).repeated


def test_frames_without_partner_are_counted_and_bounded() -> None:
    pairing = pairing_of(depth=4)
    steps = [pairing.push("a", i * 100 * MS, None) for i in range(10)]
    assert sum(step.unpaired for step in steps) == 6
    late = pairing.push("b", 900 * MS, None)
    assert len(late.sets) == 1
    assert late.unpaired == 3


@given(st.data(), st.integers(1, 3))
def test_jumping_one_after_another_loses_no_pair(data: st.DataObject, cameras: int) -> None:
    names = "abc"[:cameras]
    pairing = pairing_of(names)
    before = [round(i * 33.3 * MS) + 500 * MS for i in range(10)]
    feed(pairing, *[(c, s) for s in before for c in names])
    after = before[:5] if data.draw(st.booleans()) else [s - 450 * MS for s in before[:5]]
    # One camera runs ahead of the others by up to two frames while all jump.
    order = interleaved(data, dict.fromkeys(names, after), skew=2)
    jumps = 0
    sets = []
    for camera, stamp in order:
        step = pairing.push(camera, stamp, None)
        jumps += step.jumped
        sets += [tuple(s for s, _ in members) for members in step.sets]
    assert jumps == cameras
    assert sets == [(s,) * cameras for s in after]


def test_frames_from_before_a_jump_never_pair_with_those_after() -> None:
    pairing = pairing_of()
    frames = [("a", 0), ("b", 0), ("b", 100 * MS), ("a", 200 * MS), ("a", 50 * MS)]
    # b's frame at 100 ms is of the old time; a's second one of the new.
    assert feed(pairing, *frames, ("a", 100 * MS)) == [(0, 0)]


def test_a_jump_of_all_cameras_is_one() -> None:
    pairing = pairing_of("abc")
    first = [
        pairing.push(camera, stamp, stamp).first_to_jump
        for _ in range(3)
        for stamp in (0, 100 * MS)
        for camera in "abc"
    ]
    assert first.count(True) == 2
    # One whose clock alone goes back again and again.
    alone = [pairing.push("b", stamp * MS, stamp).first_to_jump for stamp in (90, 80, 70)]
    assert alone == [True] * 3


def test_one_camera_whose_clock_hiccups_pairs_again() -> None:
    pairing = pairing_of()
    stamps = [i * 33 * MS for i in range(1, 8)]
    frames = [(c, s) for s in stamps[:3] for c in "ab"]
    frames += [("a", 3600_000 * MS)]
    frames += [(c, s) for s in stamps[3:] for c in "ab"]
    assert feed(pairing, *frames) == [(s, s) for s in stamps]


def interleaved(
    data: st.DataObject, streams: dict[str, list[int]], skew: int
) -> list[tuple[str, int]]:
    """Any order in which no stream is ahead of another by more than `skew` frames."""
    done = dict.fromkeys(streams, 0)
    order = []
    while any(done[c] < len(s) for c, s in streams.items()):
        least = min(done[c] for c in streams if done[c] < len(streams[c]))
        free = [c for c in streams if done[c] < len(streams[c]) and done[c] - least <= skew]
        camera = data.draw(st.sampled_from(free))
        order.append((camera, streams[camera][done[camera]]))
        done[camera] += 1
    return order


@given(st.data(), st.integers(1, 3), st.integers(0, 60))
def test_sets_do_not_depend_on_how_streams_interleave(
    data: st.DataObject, cameras: int, slop_ms: int
) -> None:
    streams = {}
    for camera in "abc"[:cameras]:
        gaps = data.draw(st.lists(st.integers(1, 80), min_size=1, max_size=12))
        streams[camera] = [sum(gaps[: i + 1]) * MS for i in range(len(gaps))]
    results = []
    for _ in range(2):
        pairing = pairing_of("abc"[:cameras], slop_ms * MS, depth=20)
        results.append(feed(pairing, *interleaved(data, streams, skew=20)))
    assert results[0] == results[1]
    for members in results[0]:
        assert max(members) - min(members) <= slop_ms * MS
    for camera in range(cameras):
        used = [members[camera] for members in results[0]]
        assert used == sorted(set(used))


@given(st.data(), st.integers(2, 3), st.floats(-0.45, 0.45))
def test_steady_streams_lose_no_pair(data: st.DataObject, cameras: int, offset: float) -> None:
    # Cameras out of step by less than half a period: every frame finds its own partner.
    period = 33 * MS
    names = "abc"[:cameras]
    shift = {c: round(offset * period * i / (cameras - 1)) for i, c in enumerate(names)}
    streams = {c: [i * period + shift[c] + period for i in range(12)] for c in names}
    sets = feed(pairing_of(names, slop=period // 2, depth=10), *interleaved(data, streams, skew=1))
    assert sets == [tuple(streams[c][i] for c in names) for i in range(12)]


S = 1000 * MS


def fed_without(missing: range, cameras: str = "ab", timeout: int = 2 * S) -> list[tuple[int, ...]]:
    """Sets of five a second, the last camera's frames of some numbers missing; stamps in frames."""
    pairing: Pairing = Pairing(list(cameras), SLOP, 10, timeout)
    sets = []
    for i in range(60):
        for camera in cameras if i not in missing else cameras[:-1]:
            for members in pairing.push(camera, i * 200 * MS, camera).sets:
                assert [item for _, item in members] == list(cameras[: len(members)])
                assert len({stamp for stamp, _ in members}) == 1
                sets.append((members[0][0] // (200 * MS), len(members)))
    return sets


@pytest.mark.parametrize("cameras", ["ab", "abc"])
def test_sets_are_made_without_a_silent_camera_until_it_is_back(cameras: str) -> None:
    number = len(cameras)
    pairs = [(i, number) for i in range(60)]
    assert fed_without(range(60, 60), cameras) == pairs
    # It is more than two seconds from number 10 to 21. Number 40 is taken before the last camera's,
    # by which that is heard again, comes.
    alone = [(i, number - 1) for i in range(21, 41)]
    assert fed_without(range(10, 40), cameras) == [*pairs[:10], *alone, *pairs[41:]]
    assert fed_without(range(10), cameras) == pairs[10:]
    # One that never came.
    assert fed_without(range(60), cameras) == [(i, number - 1) for i in range(11, 60)]
    assert fed_without(range(10, 40), cameras, timeout=0) == [*pairs[:10], *pairs[40:]]


def test_what_waited_for_a_silent_camera_is_old_and_counted() -> None:
    pairing: Pairing = Pairing(["a", "b"], SLOP, 10, 2 * S)
    steps = [pairing.push("a", i * 300 * MS, None) for i in range(9)]
    assert [len(step.sets) for step in steps] == [0] * 7 + [1, 1]
    assert sum(step.unpaired for step in steps) == 7


def test_a_slow_camera_is_not_silent() -> None:
    """Frames three seconds apart, one of which is lost."""
    pairing: Pairing = Pairing(["a", "b"], SLOP, 10, 2 * S)
    frames = [(c, i * 3 * S) for i in range(6) for c in "ab" if (c, i) != ("b", 3)]
    assert feed(pairing, *frames) == [(i * 3 * S,) * 2 for i in (0, 1, 2, 4, 5)]


def test_a_jump_back_begins_the_wait_anew() -> None:
    pairing: Pairing = Pairing(["a", "b"], SLOP, 10, 2 * S)
    later = [pairing.push("a", 100 * S + i * 200 * MS, None) for i in range(10)]
    earlier = [pairing.push("a", i * 200 * MS, None) for i in range(12)]
    assert [len(step.sets) for step in (*later, *earlier)] == [0] * 21 + [1]


@pytest.mark.parametrize(
    ("cameras", "slop", "depth"), [([], 0, 10), (["a", "a"], 0, 10), (["a"], -1, 10), (["a"], 0, 1)]
)
def test_wrong_arguments(cameras: list[str], slop: int, depth: int) -> None:
    with pytest.raises(ValueError, match=r"cameras|slop_ns"):
        Pairing(cameras, slop, depth)


def test_a_wrong_timeout() -> None:
    with pytest.raises(ValueError, match="timeout_ns"):
        Pairing(["a"], 0, timeout_ns=-1)
