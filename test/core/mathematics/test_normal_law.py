"""The normal law, beside the library's."""

from __future__ import annotations

import numpy as np
import scipy.stats

from horizon_sensor_ros.core.mathematics.normal_law import normal_cdf, normal_density

_X = np.linspace(-30.0, 30.0, 601)[:600].reshape(3, -1)


def test_it_is_the_librarys_to_the_last_digits_of_its_tails() -> None:
    np.testing.assert_allclose(normal_cdf(_X), scipy.stats.norm.cdf(_X), rtol=1e-12)
    np.testing.assert_allclose(normal_density(_X), scipy.stats.norm.pdf(_X), rtol=1e-12)
