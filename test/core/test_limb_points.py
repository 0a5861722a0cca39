"""Limb points of one image: some of them."""

from __future__ import annotations

import numpy as np

from horizon_sensor_ros.core.limb_points import LimbPoints
from horizon_sensor_ros.core.status import Status


def test_some_points_keep_what_is_known_of_them_and_only_that() -> None:
    px, sigma_px = np.arange(6.0).reshape(3, 2), np.array([0.1, 0.2, 0.3])
    normal_px = np.array([[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0]])
    bare = LimbPoints(Status.OK, "", px, normal_px, sigma_px)
    told = LimbPoints(Status.OK, "", px, normal_px, sigma_px, offset_px=sigma_px, step=9 * sigma_px)
    for which in (np.array([False, True, True]), np.array([1, 2])):
        some = bare.take(which)
        np.testing.assert_array_equal(some.px, px[1:])
        np.testing.assert_array_equal(some.normal_px, normal_px[1:])
        np.testing.assert_array_equal(some.sigma_px, [0.2, 0.3])
        assert some.offset_px.size == some.step.size == 0
        some = told.take(which)
        np.testing.assert_array_equal(some.offset_px, [0.2, 0.3])
        np.testing.assert_array_equal(some.step, 9 * sigma_px[1:])
