"""Frames of the Sun alone: drawn as told, the same from the same draws."""

from __future__ import annotations

import numpy as np

from horizon_sensor_ros.sim.sun_alone import GHOST_SHARE, RING_SHARE, sun_alone


def test_a_frame_is_what_its_draws_say() -> None:
    one, same, other = (sun_alone(320, 240, np.random.default_rng(seed)) for seed in (1, 1, 2))
    assert one.image.shape == (240, 320)
    assert one.image.dtype == np.uint8
    np.testing.assert_array_equal(one.image, same.image)
    assert (one.ring, one.ghost) == (same.ring, same.ghost)
    assert not np.array_equal(one.image, other.image)


def test_most_show_the_sun_overexposed_and_some_its_ring_and_ghost() -> None:
    frames = [sun_alone(160, 120, np.random.default_rng([3, i])) for i in range(150)]
    assert np.mean([frame.image.max() == 255 for frame in frames]) > 0.5
    assert abs(np.mean([frame.ring for frame in frames]) - RING_SHARE) < 0.12
    assert abs(np.mean([frame.ghost for frame in frames]) - GHOST_SHARE) < 0.12
    # Space is dark in all but those that halo or rays flood.
    assert np.median([np.percentile(frame.image, 5) for frame in frames]) < 40
