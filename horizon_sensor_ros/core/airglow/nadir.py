"""Nadir by the night's airglow, a second limb above the ground's, joined with the ground's own.

By moonlight the ground's limb is dim and all texture, and what one camera makes of a short arc of
it is off by a degree at times. The layer above has no texture: its height changes by a few
kilometres in a thousand. How high it is is not known as well, so that it tells nadir alone.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from horizon_sensor_ros.core.airglow.edge import airglow_edge, sphere_of_airglow
from horizon_sensor_ros.core.cameras.camera_view import CameraView
from horizon_sensor_ros.core.covariance.shared_error import bend_px, with_shared_error
from horizon_sensor_ros.core.fits.assessment import birge_factor, tangent_rows
from horizon_sensor_ros.core.fits.maximum_likelihood import fit_maximum_likelihood
from horizon_sensor_ros.core.fits.moved import moved
from horizon_sensor_ros.core.fits.observation import LimbObservation
from horizon_sensor_ros.core.fits.result import HorizonFit
from horizon_sensor_ros.core.limb.search.stars import shows_stars
from horizon_sensor_ros.core.limb.search.working_image import WorkingImage
from horizon_sensor_ros.core.mathematics.attitude import tangent_basis
from horizon_sensor_ros.core.planet import Planet
from horizon_sensor_ros.core.status import Status

# Edges farther off the layer's cone than so many of their own and the stretches' sigmas are of the
# craft, stars or cloud; most of a layer's are not.
_OFF, _LEAST_SHARE = 3.0, 0.6
_MOST_BEND = 3.0  # of the layer's stretches, over what they claim: aurora is no layer
# In 40 photographs by night there are 3 and more, most of them dozens; in 5 by day with what seemed
# an edge of airglow, none.
_LEAST_STARS = 3


def fit_airglow(
    frames: Sequence[tuple[np.ndarray, LimbObservation]], fit: HorizonFit, sphere: Planet
) -> HorizonFit | None:
    """Cone of the airglow's upper edge above the limb of a fit, of the cameras that are in it.

    frames : image (H, W), and what its camera saw of the limb. Its nadir stands beside the fit's,
    its altitude is above the layer. None where the layer does not show, or is no limb.
    """
    seen = [
        LimbObservation(
            ground.view, airglow_edge(gray, ground.view, fit.nadir_base, fit.rho_rad, sphere)
        )
        for gray, ground in frames
        if ground.view.name in fit.cameras
    ]
    found = cone_of_airglow(seen, sphere_of_airglow(sphere), _LEAST_SHARE, _MOST_BEND)
    return None if found is None else found[0]


def under_stars(
    views: Sequence[CameraView],
    working: Sequence[WorkingImage],
    airglow: HorizonFit,
    least: int = _LEAST_STARS,
) -> bool:
    """Whether there are stars above what may be the airglow, at least so many in one of the working
    images. By day, when there are none, edges of haze, ghosts and compression run beside the
    limb as well.
    """
    used = [i for i, view in enumerate(views) if view.name in airglow.cameras]
    return shows_stars(
        [views[i] for i in used],
        [working[i] for i in used],
        airglow.nadir_base,
        airglow.rho_rad,
        least,
    )


def cone_of_airglow(
    seen: Sequence[LimbObservation], layer: Planet, least_share: float, most_bend: float
) -> tuple[HorizonFit, tuple[LimbObservation, ...]] | None:
    """Cone that fits edges of the airglow, with what they share of errors, and those that lie on
    it; None where too few do, or they bend.

    layer : the sphere whose limb they are. least_share : on the cone, of all. most_bend : of their
    stretches, over what these claim.
    """
    if not any(one.limb.status is Status.OK for one in seen):
        return None
    found = fit_maximum_likelihood(seen, layer)
    if not found.ok:
        return None
    on_it = tuple(_of_layer(one, found) for one in seen)
    if sum(len(one.rays) for one in on_it) < least_share * sum(len(one.rays) for one in seen):
        return None
    found = fit_maximum_likelihood(on_it, layer, (found.nadir_base, found.rho_rad))
    if not found.ok:
        return None
    bends = (
        bend_px(found, one.rays) / one.limb.shared.coherent_px for one in on_it if len(one.rays)
    )
    if any(bend > most_bend for bend in bends):
        return None
    return with_shared_error(found, on_it, layer), on_it


def _of_layer(seen: LimbObservation, found: HorizonFit) -> LimbObservation:
    """Those of the edges that lie on the cone."""
    limb = seen.limb
    if limb.status is not Status.OK:
        return seen
    off_px = np.abs(seen.rays.residuals_px(found.nadir_base, found.rho_rad))
    on_it = off_px < _OFF * np.hypot(limb.sigma_px, limb.shared.coherent_px)
    return LimbObservation(seen.view, limb.take(on_it))


def with_airglow(
    fit: HorizonFit, airglow: HorizonFit, common: np.ndarray, sphere: Planet
) -> HorizonFit:
    """Return the estimate of a fit given the airglow's nadir too.

    common : (4, 4) part of the fit's covariance that is the airglow's as well, of cameras and
    planet: it does not tell the two apart, and stays. The minimum-variance update of a Gaussian
    estimate (Kalman 1960); on a short arc altitude hangs together with nadir, and gains. Where the
    two are farther apart than they claim that grows (`birge_factor`). Unchanged where no limb would
    be seen from there.
    """
    basis = tangent_basis(fit.nadir_base)
    to_tangent = tangent_rows(basis)
    own = to_tangent @ (fit.cov_nadir_altitude - common) @ to_tangent.T
    theirs = basis.T @ airglow.cov_nadir_altitude[:3, :3] @ basis
    apart = basis.T @ (airglow.nadir_base - fit.nadir_base)
    weight = np.linalg.inv(own[:2, :2] + theirs)
    gain = own[:, :2] @ weight
    birge = birge_factor(float(apart @ weight @ apart), 2)
    cov = to_tangent.T @ (birge * (own - gain @ own[:2])) @ to_tangent + common
    return moved(fit, to_tangent.T @ (gain @ apart), cov, sphere) or fit
