"""The ground beside a limb under glowing air, as a Gaussian field over K stretches and J samples.

Its covariance, noise included, is

    B x f f' + s^2 L x A + 1 x D

where x is Kronecker's product: B of the levels, what all have in common and what each has of its
own, and f the blurred step; s the texture's strength, L how alike it is along the limb and A across
it; D the noise of each sample. What levels have in common counts among the unknowns, and so does
the error of each sample that is blind. The rest has axes, the same for every strength, along which
nothing hangs together.
Source: derived here; for Kronecker products see Rasmussen & Williams 2006, 5.4.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from horizon_sensor_ros.core.limb.texture.ground_texture import rough_correlation, seen_across
from horizon_sensor_ros.core.mathematics.normal_law import normal_cdf

_COMMON_LEVEL, _OWN_LEVEL = 1.0, 0.15  # of all stretches and of each, over the brightest


class Ground:
    """Levels and texture of K stretches in samples at d_px (J,) outside the limb.

    extra : (K, J, E) what else is unknown of it, in its axes, and extra_prior : (E,) information on
    that beforehand.
    """

    def __init__(
        self,
        d_px: np.ndarray,
        psf_px: float,
        px_over_radius: float,
        stretch_px: float,
        keep: np.ndarray,
        bright: float,
        variance: np.ndarray,
        doubt: np.ndarray,
        lit: np.ndarray | None = None,
    ) -> None:
        """Of the kept stretches (M,). variance (J,) : of the noise. doubt (K, J) : variance besides
        it, where a sample is blind. lit (K,) : how brightly each is lit, over the brightest; None
        if evenly.
        """
        blurs = d_px / psf_px
        self.edge = normal_cdf(-blurs)
        self.fall = np.exp(-0.5 * np.square(blurs)) / (np.sqrt(2.0 * np.pi) * psf_px)
        self.widening = self.fall * blurs
        across, self._moved, self._widened = seen_across(d_px, psf_px, px_over_radius)
        ground = float(f"{stretch_px * px_over_radius:.3g}")
        self._evenly = lit is None
        if lit is None:
            self._lit = np.ones(np.count_nonzero(keep))
            self._alike, self._along = _axes_along(keep.tobytes(), ground)
        else:
            self._lit = lit
            self._alike, self._along = _axes_of(keep, ground, lit)
        self._own, self._common = (_OWN_LEVEL * bright) ** 2, (_COMMON_LEVEL * bright) ** 2
        alone = self._own * np.outer(self.edge, self.edge)
        alone.flat[:: len(d_px) + 1] += variance
        self._alone, self._across = alone, across
        whiten = np.linalg.inv(np.linalg.cholesky(alone))
        self._textured, turn = np.linalg.eigh(whiten @ across @ whiten.T)
        self._to_axes = turn.T @ whiten
        rows, columns = np.nonzero(doubt)
        self._doubt, self._doubted = doubt, len(rows) > 0
        count = 1 + len(rows)
        self.extra = np.empty((len(self._along), len(d_px), count))
        self._sums = self._lit @ self._along
        self.extra[..., 0] = self._sums[:, None] * (self._to_axes @ self.edge)
        self.extra[..., 1:] = self._along[rows].T[:, None] * self._to_axes[:, columns]
        self.extra_prior = np.empty(count)
        self.extra_prior[0] = 1.0 / self._common
        self.extra_prior[1:] = 1.0 / doubt[rows, columns]

    def evenly_lit(self, levels: np.ndarray) -> np.ndarray:
        """Levels (K,) as they would be if all stretches were lit like the brightest."""
        return levels / self._lit

    def in_axes(self, values: np.ndarray) -> np.ndarray:
        """Values (K, J, ...) along the axes."""
        turned = np.tensordot(self._along, values, axes=(0, 0))
        return np.asarray(np.moveaxis(np.tensordot(self._to_axes, turned, axes=(1, 1)), 0, 1))

    def precision(self, strength: np.ndarray) -> np.ndarray:
        """Inverse of the covariance (S, K, J) along the axes, for strengths (S,) of texture."""
        alike = np.square(strength)[:, None, None] * self._alike[:, None]
        return np.asarray(1.0 / (1.0 + alike * self._textured))

    def derivatives(self, weights: np.ndarray, strength: float) -> tuple[np.ndarray, np.ndarray]:
        """How the likeliest ground moves with the limb, and widens with the blur (K, J).

        weights : (K, J) residuals over their covariance, along the axes.
        """
        both = np.stack([weights, (strength**2 * self._alike)[:, None] * weights])
        weights, textured = (self._along @ both) @ self._to_axes
        level = weights @ self.edge
        level = (self._own * level + self._common * (self._lit @ level) * self._lit)[:, None]
        return (
            level * self.fall + textured @ self._moved.T,
            level * self.widening + textured @ self._widened.T,
        )

    def volume(self, precision: np.ndarray, strength: float) -> tuple[np.ndarray, float]:
        """Half of how the covariance's log determinant grows, by each edge (K,) and by the blur.

        precision : (K, J) along the axes.
        """
        alike = strength**2 * self._alike
        extra = self.extra * precision[..., None]
        known = np.tensordot(self.extra, extra, axes=((0, 1), (0, 1))) + np.diag(self.extra_prior)
        half = np.linalg.inv(np.linalg.cholesky(known)).T
        shared = extra @ half
        both = np.stack([shared, alike[:, None, None] * shared])
        both = np.tensordot(self._along, both, axes=(1, 1))  # K, 2, J, E
        shared, textured = np.swapaxes(np.swapaxes(both, 2, 3) @ self._to_axes, 0, 1)
        level = shared @ self.edge
        level = self._own * level + self._common * self._lit[:, None] * (self._lit @ level)
        square = np.square(self._along)
        out = []
        for change, moved in ((self.fall, self._moved), (self.widening, self._widened)):
            steps = (self._to_axes @ change) * (self._to_axes @ self.edge)
            texture = ((self._to_axes @ moved) * self._to_axes).sum(axis=1)
            leveled = precision @ steps
            grows = square @ (self._own * leveled + alike * (precision @ texture))
            grows += self._common * self._lit * (self._along @ (self._sums * leveled))
            grows -= ((shared @ change) * level).sum(axis=1)
            grows -= ((shared @ moved) * textured).sum(axis=(1, 2))
            out.append(grows)
        return out[0], float(out[1].sum())

    def cost(self, left: np.ndarray, strength: float) -> np.ndarray:
        """Cost (K,) of what is left of each stretch (K, J), taken by itself."""
        ground = self._common * np.outer(self.edge, self.edge) + strength**2 * self._across
        if self._evenly and not self._doubted:
            alone = self._alone + ground
            return np.asarray((left * np.linalg.solve(alone, left.T).T).sum(axis=1))
        alone = self._alone + np.square(self._lit)[:, None, None] * ground
        doubted = alone + self._doubt[:, :, None] * np.eye(len(self.edge))
        return np.asarray((left * np.linalg.solve(doubted, left[..., None])[..., 0]).sum(axis=1))


@lru_cache(maxsize=16)
def _axes_along(keep: bytes, ground: float) -> tuple[np.ndarray, np.ndarray]:
    """`_axes_of` evenly lit stretches."""
    which = np.frombuffer(keep, dtype=bool)
    return _axes_of(which, ground, np.ones(np.count_nonzero(which)))


def _axes_of(keep: np.ndarray, ground: float, lit: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """How much of the texture lies along each of its axes along the limb (K,), and these (K, K), of
    kept stretches of a length of ground each, with the share (K,) of light that they get.
    """
    along = np.flatnonzero(keep) * ground
    alike, axes = np.linalg.eigh(np.outer(lit, lit) * rough_correlation(along[:, None] - along))
    return np.maximum(alike, 0.0), axes
