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

from dataclasses import dataclass, replace

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
_LEAST_SIGMA = 0.007
#: Standard deviation of the translation that constant depth does not explain, as a fraction of it. Where
#: the camera moves as it rotates, it would appear as an error of the focal length.
_DEPTH_VARIES = 0.2
#: Rotations about x and y: maximum fraction of the camera's rate that the model leaves unexplained.
_MOST_LEFT = 0.12
#: Minimum rate about x and y [rad/s]: a window of slower events moves by a few pixels, and its rate is up to
#: 10 % too large. Then the minimum number of windows with a known velocity.
_LEAST_RATE, _LEAST_WINDOWS = 0.6, 24


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
    model = _with_velocity(model)
    if len(model.camera) < _LEAST_WINDOWS:
        return 1.0, np.inf
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
    moved = translation @ x[8:]
    sigma = _sigma(model, normal, (model.camera - predicted, moved), jacobian, scale)
    return float(np.exp(x[0])), sigma


def _with_velocity(model: RateModel) -> RateModel:
    """The windows whose velocity is known."""
    known = np.flatnonzero(np.any(model.velocity != 0.0, axis=(1, 2)))
    place = np.concatenate([[0.0], np.cumsum(model.gaps)])
    return replace(
        model,
        camera=model.camera[known],
        body=model.body[known],
        gaps=np.diff(place[known]),
        values=model.values * len(known) / max(len(model.camera), 1),
        velocity=model.velocity[known],
    )


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
    model: RateModel,
    normal: FloatArray,
    parts: tuple[FloatArray, FloatArray],
    jacobian: FloatArray,
    scale: float,
) -> float:
    """Sigma of the logarithm: by the innovations, by what agrees with the rotation by chance, and by a scene
    whose depth is not constant. `parts`: residuals and apparent rotation (N,3) of the translation."""
    residual, moved = parts
    left, count = spread(residual), model.camera.size
    noise = np.linalg.inv(normal)[0, 0] * count / max(count - len(normal), 10)
    row = jacobian[:, :, 0] / left
    information = max(float((row**2).sum()), 1e-12)
    chance = len(residual) / (information * min(model.values, len(residual)))
    depth = _DEPTH_VARIES * float((row * moved / left).sum()) / information
    sigma = float(np.sqrt(noise + chance + depth**2 + _LEAST_SIGMA**2))
    across = float(np.sqrt(((model.body @ model.C_c_b.T / scale)[:, :2] ** 2).mean(axis=0).sum()))
    explained = across > _LEAST_RATE and float(np.hypot(left[0], left[1])) < _MOST_LEFT * across
    return sigma if explained and sigma < _MOST_SIGMA else np.inf
