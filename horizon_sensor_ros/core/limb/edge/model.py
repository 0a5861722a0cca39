"""What the brightness across a limb looks like, and how likely each place of such an edge is.

Along the normal, position d (pixels, outwards), the model of one profile with the edge at e is

    I(d) = background + level * (F(e - d) + glow * G(d - e)) + texture(d) + noise

F is a step blurred by the point-spread function (normal law, sigma `psf_px`); G is air glow: an
exponential outside the edge, blurred alike, whose height is a share `glow` (0 to 1) of the level
just inside; texture is whatever cloud and ground do inside: a Gaussian process with the covariance
of surface detail seen at grazing incidence, blurred alike; its strength and roughness are those
that make the image's profiles most likely. Background and level are free for every
profile. For each e on a grid the profile likelihood (restricted, so that the free amplitudes cost
what they should) is one matrix product; the table of matrices depends on the shape alone and is
kept. Texture beside the limb thereby widens the answer instead of moving it, and glow that is
strong over dark ground and weak over bright cloud does not bend the limb. Air so thick that it
hides the ground has a law of its own, without F and G: see `haze.limb`.
"""

from __future__ import annotations

from collections import OrderedDict
from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np

from horizon_sensor_ros.core.limb.air import Air
from horizon_sensor_ros.core.limb.profiles import ProfileGrid
from horizon_sensor_ros.core.mathematics.normal_law import normal_cdf


@dataclass(frozen=True)
class Texture:
    """What the surface adds to the brightness just inside the limb, where profiles are taken one by
    one: in the root of the depth in pixels, so that one table serves all altitudes and cameras.
    What profiles tell together is weighed over distances on the ground: `texture.ground_texture`.

    amplitude : over that brightness. rough : it jumps, as at borders of clouds, instead of having
    gradients.
    """

    amplitude: float
    rough: bool = False


# What is considered: texture of the surface, one for all profiles of an image; height of the air's
# glow over the brightness just inside the limb, for every profile its own.
SHARP_TEXTURES = (
    *(Texture(amplitude) for amplitude in (0.0, 0.03, 0.1, 0.4)),
    *(Texture(amplitude, rough=True) for amplitude in (0.1, 0.3, 0.9)),
)
GLOW_TEXTURES = tuple(Texture(amplitude, rough=True) for amplitude in (0.06, 0.25))
GLOW_SHARES = (0.25, 0.6, 1.0)
HAZE_TEXTURES = tuple(Texture(amplitude, rough=True) for amplitude in (0.05, 0.2))
PSF_LADDER_PX = tuple(float(psf) for psf in np.round(0.42 * 1.06 ** np.arange(37), 3))
GLOW_LADDER_PX = (1.0, 1.6, 2.5, 4.0, 6.3, 10.0)
# Correlation length of texture, in the root of the depth in pixels.
_SMOOTH_ROOT_LENGTH, _ROUGH_ROOT_LENGTH = 3.0, 1.5
# Of tables, of all looks and levels: towards the terminator one search asks for 300 of them, 46 MB.
KEPT_BYTES = 64e6
_SMALL = 6  # rows of a matrix that is not worth halving
MAX_LEVEL = 512.0  # brightness over noise beyond which more says nothing
_FINE_PX = 0.1  # grid on which the texture's covariance is blurred
SHAPE_ERROR = 0.003  # what interpolation and a not quite normal blur add, over the level
_GLOW_ERROR = 0.03  # the same with glow, which is never quite exponential
_HAZE_ERROR = 0.01  # and with haze
# Depth below the edge of hazy air, over its scale height, from where on ground may shine through.
_HIDDEN = 1.0
# The normal law, by which brightness is blurred where no closed form is known.
_NODES = np.linspace(-4.0, 4.0, 33)
_WEIGHTS = np.exp(-0.5 * _NODES**2) / np.exp(-0.5 * _NODES**2).sum()


@dataclass(frozen=True, eq=False)
class EdgeTable:
    """Precomputed likelihood of the edge's place, for profiles in units of their noise.

    Of several textures and glows they are stacked, along one more axis in front.

    residual (E, J - 2, J): what background and level leave of the whitened profile, the cost of
    place e is ``|residual[e] @ I|^2 + log_det[e]``. step (E, J): the step's estimate is
    ``step[e] @ I``.
    """

    residual: np.ndarray
    log_det: np.ndarray
    step: np.ndarray

    @property
    def nbytes(self) -> int:
        """What the likelihoods take."""
        return self.residual.nbytes + self.log_det.nbytes + self.step.nbytes

    def looked_up(self, profiles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Squares of residuals, and steps, of profiles (N, J), for every place: (N, ..., E)."""
        num = profiles.shape[1]
        shape = len(profiles), *self.log_det.shape
        rows = self.residual.shape[-2]
        stacked = (profiles @ self.residual.reshape(-1, num).T).reshape(-1, rows)
        squares = np.einsum("ij,ij->i", stacked, stacked).reshape(shape)
        return squares, (profiles @ self.step.reshape(-1, num).T).reshape(shape)


@dataclass(frozen=True)
class EdgeLook:
    """What the edge looks like in one image.

    psf_px : its blur, one sigma. glow_px : length over which air glow fades by e; 0 without glow.
    haze : the air is so thick that it hides the ground; the edge is where its optical depth is one.
    air : that glows, as it was last found, together with the limb; looks are alike without it.
    """

    psf_px: float
    glow_px: float
    haze: bool = False
    air: Air | None = field(default=None, compare=False)

    def neighbours(self) -> tuple[EdgeLook, ...]:
        """Looks one step of their ladders away: blur, and where there is glow its length."""
        beside = _beside(PSF_LADDER_PX, self.psf_px)
        psf = [EdgeLook(value, self.glow_px) for value in beside]
        if self.glow_px == 0:
            return tuple(psf)
        glow = [EdgeLook(self.psf_px, value) for value in _beside(GLOW_LADDER_PX, self.glow_px)]
        return tuple(psf + glow)

    @property
    def textures(self) -> tuple[Texture, ...]:
        """Textures to consider."""
        if self.haze:
            return HAZE_TEXTURES
        return GLOW_TEXTURES if self.glow_px > 0 else SHARP_TEXTURES

    @property
    def glows(self) -> tuple[float, ...]:
        """Heights of glow to consider in every profile."""
        return GLOW_SHARES if self.glow_px > 0 and not self.haze else (0.0,)

    @property
    def hidden_px(self) -> float:
        """How far inside the edge the ground's texture begins."""
        return _HIDDEN * self.glow_px if self.haze else 0.0


@lru_cache(maxsize=256)
def _beside(ladder: tuple[float, ...], value: float) -> tuple[float, ...]:
    index = int(np.argmin(np.abs(np.log(np.array(ladder) / value))))
    return tuple(ladder[i] for i in (index - 1, index + 1) if 0 <= i < len(ladder))


def edge_profile(x_px: np.ndarray, look: EdgeLook, glow: float) -> np.ndarray:
    """Brightness (K,) at signed distances from the edge, for level one and no background."""
    if look.haze:
        depth = np.exp(np.minimum((look.psf_px * _NODES - x_px[:, None]) / look.glow_px, 50.0))
        return np.asarray((1.0 - np.exp(-depth)) @ _WEIGHTS)
    x = x_px / look.psf_px
    profile = normal_cdf(-x)
    if glow > 0:
        k = look.psf_px / look.glow_px
        # exp(-d / L) for d > 0, convolved with the normal law.
        tail = np.exp(np.minimum(0.5 * k * k - k * x, 50.0)) * normal_cdf(x - k)
        profile = profile + glow * tail
    return profile


def texture_covariance(x_px: np.ndarray, psf_px: float, rough: bool) -> np.ndarray:
    """Covariance of unit surface texture at signed distances x_px from the limb (planet: x < 0),
    blurred; (K, K).

    Ground distance grows with the square root of the depth below the limb, so detail of one size
    is squeezed together towards the edge: the covariance is one in the root of the depth,
    exponential where texture is rough and Matern's once differentiable one where it is smooth.
    """
    # Counted from the limb inwards: the texture begins at the limb, wherever the samples lie.
    fine = -_FINE_PX * (np.arange(np.ceil((4.0 * psf_px - min(x_px[0], 0.0)) / _FINE_PX)) + 0.5)
    root = np.sqrt(-fine)
    apart = np.abs(np.subtract.outer(root, root))
    if rough:
        covariance = np.exp(-apart / _ROUGH_ROOT_LENGTH)
    else:
        apart *= np.sqrt(3.0) / _SMOOTH_ROOT_LENGTH
        covariance = (1.0 + apart) * np.exp(-apart)
    blur = np.exp(-0.5 * ((x_px[:, None] - fine) / psf_px) ** 2)
    blur *= _FINE_PX / (np.sqrt(2.0 * np.pi) * psf_px)
    return blur @ covariance @ blur.T


@lru_cache(maxsize=16)
def _differences(
    psf_px: float, hidden_px: float, grid: ProfileGrid
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """All differences (K,) of sample and edge that occur in a grid, and the covariances of unit
    texture there, smooth and rough.

    hidden_px : how far inside the edge it begins.
    """
    stride = round(1.0 / grid.grid_px)
    first = grid.d_px[0] - grid.e_px[-1]
    x_px = first + grid.grid_px * np.arange(stride * (grid.num - 1) + len(grid.e_px))
    smooth, rough = (texture_covariance(x_px + hidden_px, psf_px, rough) for rough in (False, True))
    return x_px, smooth, rough


def tables_of(
    look: EdgeLook,
    textures: tuple[Texture, ...],
    glows: tuple[float, ...],
    level: float,
    grid: ProfileGrid,
) -> EdgeTable:
    """Tables of all pairs of a texture and a height of glow, one after the other (K, E, ...).

    level : brightness just inside the limb, over the noise.
    """
    e_px, num = grid.e_px, grid.num
    stride = round(1.0 / grid.grid_px)
    x_px, smooth, rough = _differences(look.psf_px, look.hidden_px, grid)
    taken = (len(e_px) - 1 - np.arange(len(e_px)))[:, None] + stride * np.arange(num)
    rows, columns = taken[:, :, None], taken[:, None, :]
    smooth, rough = smooth[rows, columns], rough[rows, columns]
    profile = np.stack([edge_profile(x_px, look, glow) for glow in glows])[:, taken]
    error = np.array([_error(look, glow) for glow in glows])
    own = 1.0 + np.square(level * error[:, None, None] * profile)
    cov = np.empty((len(textures), len(glows), len(e_px), num, num))
    for i, texture in enumerate(textures):
        cov[i] = (level * texture.amplitude) ** 2 * (rough if texture.rough else smooth)
    cov[..., np.arange(num), np.arange(num)] += own
    basis = np.empty((*profile.shape, 2))
    basis[..., 0], basis[..., 1] = 1.0, profile
    lower = np.linalg.cholesky(cov)
    whiten = inverse_of_lower(lower)
    q, r = np.linalg.qr(whiten @ basis, mode="complete")
    free, rotated = basis.shape[-1], np.swapaxes(q, -1, -2) @ whiten
    r = r[..., :free, :]
    step = np.linalg.solve(r, rotated[..., :free, :])[..., 1, :]
    log_det = sum(
        2.0 * np.log(np.abs(np.diagonal(part, axis1=-2, axis2=-1))).sum(axis=-1)
        for part in (lower, r)
    )

    def stacked(values: np.ndarray, dtype: type) -> np.ndarray:
        return values.reshape(-1, *values.shape[2:]).astype(dtype)

    return EdgeTable(
        stacked(rotated[..., free:, :], np.float32),
        stacked(np.asarray(log_det), np.float64),
        stacked(step, np.float32),
    )


def _error(look: EdgeLook, glow: float) -> float:
    """What no model of the edge gets right, over the level."""
    if look.haze:
        return _HAZE_ERROR
    return _GLOW_ERROR if glow > 0.0 else SHAPE_ERROR


def inverse_of_lower(lower: np.ndarray) -> np.ndarray:
    """Inverses of lower triangular matrices (..., N, N), by halves."""
    num = lower.shape[-1]
    if num <= _SMALL:
        return np.linalg.inv(lower)
    half = num // 2
    out = np.zeros_like(lower)
    first = out[..., :half, :half] = inverse_of_lower(lower[..., :half, :half])
    last = out[..., half:, half:] = inverse_of_lower(lower[..., half:, half:])
    out[..., half:, :half] = -last @ (lower[..., half:, :half] @ first)
    return out


class KeptTables:
    """The tables used last, up to so many bytes of them."""

    def __init__(self, most_bytes: float) -> None:
        self._most_bytes = most_bytes
        self.nbytes = 0
        self._tables: OrderedDict[tuple[float, ...], EdgeTable] = OrderedDict()

    def of(self, look: EdgeLook, level: float, grid: ProfileGrid) -> EdgeTable:
        """Tables of all the look's textures and glows, one after the other (K, E, ...)."""
        # Plain numbers, which are hashed far sooner than what has them.
        key = look.psf_px, look.glow_px, look.haze, level, *grid.key
        table = self._tables.pop(key, None)
        if table is None:
            table = tables_of(look, look.textures, look.glows, level, grid)
            self.nbytes += table.nbytes
        self._tables[key] = table
        while self.nbytes > self._most_bytes and len(self._tables) > 1:
            _, oldest = self._tables.popitem(last=False)
            self.nbytes -= oldest.nbytes
        return table


edge_tables = KeptTables(KEPT_BYTES).of
