# SPDX-License-Identifier: Apache-2.0
"""Focal length from the angular rates of the camera, with a translation that the accelerometer measures.

Model: `omega_c = (I + log(f) S) R (omega_b / s - b) + M v`, over windows of the camera. Rotations about x and
y move the image in proportion to the focal length `f` (true over calibrated), of which a fit over the whole
view sees the part `S`. A translation with velocity over depth `v` appears as the rotation `M v`; `v` is known
up to a few unknowns (`velocity`). They are estimated together with the scale `s` of the gyroscope, the
mounting `R` and the bias `b`, by robust Gauss-Newton on innovations. The roll depends neither on `f` nor on
`v`, so it determines `s`, which has a prior as well. For tracks, `epipolar` needs no constant depth.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from asyneio.rotation.apparent import ApparentRotation
from asyneio.rotation.fit import crosses
from asyneio.rotation.noise import CAUCHY, differences, noise_of, spread
from asyneio.types import FloatArray

_STEPS, _MOST_STEP, _CONVERGED = 15, 0.5, 1e-5
#: Prior standard deviations: logarithms of focal length and scale (data sheets), mounting [rad], bias
#: [rad/s].
_PRIOR = (0.5, 0.01, *(3 * [0.15]), *(3 * [0.05]))
#: Maximum standard deviation of the logarithm: with slower motion, the depth of the scene varies too much.
_MOST_SIGMA = 0.025
#: Errors of simulated recordings that neither the noise nor the depth of the scene explains.
_LEAST_SIGMA = 0.005
#: Rotations about x and y: maximum fraction of the camera's rate that the model leaves unexplained.
_MOST_LEFT = 0.12
#: Minimum rate about x and y [rad/s].
_LEAST_RATE = 0.05


@dataclass(frozen=True)
class RateModel:
    """Rates of the camera over windows, and what explains them.

    Attributes:
        camera: (N,3) measured rates, camera frame [rad/s].
        body: (N,3) mean gyroscope readings [rad/s].
        gaps: (N-1,) times between windows, in units of their median.
        values: number of independent values of the rate that the model does not explain.
        C_c_b: (3,3) body to camera rotation, accurate to some degrees.
        apparent: of the camera.
        velocity: (N,3,P) basis of velocity over depth in the camera frame; P may be 0.
        velocity_sigma: (P,) prior standard deviations of its coefficients.
    """

    camera: FloatArray
    body: FloatArray
    gaps: FloatArray
    values: float
    C_c_b: FloatArray
    apparent: ApparentRotation
    velocity: FloatArray
    velocity_sigma: FloatArray


def focal_of(model: RateModel, scale: float) -> tuple[float, float]:
    """True over calibrated focal length, and sigma of its logarithm (infinite: not observable).

    Args:
        model: rates, and what explains them.
        scale: gyroscope readings over true rates, known to 1 %.
    """
    translation = model.apparent.of_translation @ model.velocity
    prior = np.concatenate([_PRIOR, model.velocity_sigma])
    x, normal = np.zeros(len(prior)), np.eye(len(prior))
    for _ in range(_STEPS):
        predicted, jacobian = _predicted(model, scale, x, translation)
        residual = model.camera - predicted
        noise = noise_of(residual, model.gaps)
        innovation = differences(residual, noise.alike)
        rows = jacobian[1:] - noise.alike[:, :, None] * jacobian[:-1]
        # Each axis on its own: a roll may be an outlier where the rest is not.
        weight = 1.0 / (1.0 + (innovation / noise.sigma) ** 2 / CAUCHY) / noise.sigma**2
        normal = np.einsum("nap,na,naq->pq", rows, weight, rows) + np.diag(1.0 / prior**2)
        step = np.linalg.solve(normal, np.einsum("nap,na,na->p", rows, weight, innovation) - x / prior**2)
        x = x + np.clip(step, -_MOST_STEP, _MOST_STEP)
        if np.abs(step[:8]).max() < _CONVERGED:
            break
    predicted, jacobian = _predicted(model, scale, x, translation)
    sigma = _sigma(model, normal, model.camera - predicted, jacobian, scale)
    return float(np.exp(x[0])), sigma


def _predicted(
    model: RateModel, scale: float, x: FloatArray, translation: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Rates (N,3) according to the parameters x (8+P,), and their derivative (N,3,8+P)."""
    C = Rotation.from_rotvec(x[2:5]).as_matrix() @ model.C_c_b
    body = model.body * np.exp(-x[1]) / scale
    rate = (body - x[5:8]) @ C.T
    focal = np.eye(3) + x[0] * model.apparent.of_focal
    jacobian = np.concatenate(
        [
            (rate @ model.apparent.of_focal.T)[:, :, None],
            -(body @ C.T @ focal.T)[:, :, None],
            -focal @ crosses(rate),
            np.broadcast_to(-focal @ C, (len(body), 3, 3)),
            translation,
        ],
        axis=2,
    )
    return rate @ focal.T + translation @ x[8:], jacobian


def _sigma(
    model: RateModel, normal: FloatArray, residual: FloatArray, jacobian: FloatArray, scale: float
) -> float:
    """Sigma of the logarithm, from the innovations and from what agrees with the rotation by chance."""
    left, count = spread(residual), model.camera.size
    noise = np.linalg.inv(normal)[0, 0] * count / max(count - len(normal), 10)
    by_axis = (jacobian[:, :, 0] ** 2).mean(axis=0) / left**2
    chance = 1.0 / max(float(by_axis.sum()) * min(model.values, len(residual)), 1e-12)
    sigma = float(np.sqrt(noise + chance + _LEAST_SIGMA**2))
    across = float(np.sqrt(((model.body @ model.C_c_b.T / scale)[:, :2] ** 2).mean(axis=0).sum()))
    explained = across > _LEAST_RATE and float(np.hypot(left[0], left[1])) < _MOST_LEFT * across
    return sigma if explained and sigma < _MOST_SIGMA else np.inf
