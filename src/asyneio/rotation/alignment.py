# SPDX-License-Identifier: Apache-2.0
"""Rotation and time offset between the angular rates of a camera and those of a gyroscope.

Model: `omega_c(t) = C_c_b (omega_b(t + offset) - bias) + leak`, over windows of the camera, with the mean of
the gyroscope over the same window. The leak is the effect of a translation of the camera on an estimate that
models rotation only: mostly a slow rotation about x and y. It is modelled as autoregressive noise of order 1
with parameters per axis. These are estimated from the residuals, and the fit minimises the innovations, the
change of the residual from one window to the next. The bias has a prior at zero: if the camera rotates about
one axis at a constant rate, bias and rotation cannot be separated.

1. *Offset.* For each trial offset, the best linear map `omega_c = A omega_b + a` by robust least squares. Its
   innovations are smallest at the true offset, for any rotation, reflection or unit.
2. *Rotation and bias.* Robust Gauss-Newton from the calibrated rotation and from each of its 23 neighbours by
   right angles; the solution with the lowest cost is used.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import permutations, product

import numpy as np
from scipy.spatial.transform import Rotation

from asyneio.rotation.camera_rates import CameraRates
from asyneio.rotation.fit import BIAS_SIGMA, Fit, crosses, fit_rotation, nearest_fit
from asyneio.rotation.noise import Noise, noise_of, spread
from asyneio.rotation.time_offset import LEAST_WINDOWS, TurnOf, find_far_offset, find_offset, gaps_of
from asyneio.types import NS_PER_S, FloatArray, RecordArray

#: Gauss-Newton steps from each of the initial rotations.
_FEW_STEPS = 6
#: Independent values of the leak per second: hands and vehicles change their velocity about as often. A leak
#: that correlates with the rotation by chance acts as a rotation; the innovations contain only part of it.
_LEAKS_HZ = 4.0
#: Half the interval of the finite difference for angular accelerations [s].
_DIFFERENCE_S = 0.01
#: Difference of log-likelihoods from which a rotation is contradicted: the chance level is 1e-6.
CONTRADICTED = 15.0
#: An offset with a larger standard deviation [s] is not observable, and the calibrated one is used.
OFFSET_OBSERVABLE_S = 0.008

#: Two rolls are unrelated if they differ by this fraction of the difference of independent ones, and the roll
#: of the gyroscope exceeds this rate [rad/s]; at least this number of independent values is needed.
_UNRELATED, _FAST_ROLL, _LEAST_VALUES = 0.75, 0.15, 8.0
#: Explained fraction of the camera's rate from which both measure the same motion.
RELATED = 0.5
#: Logarithm of the number of offsets tested.
_OF_MANY = 7.0

#: The 24 rotations that map axes to axes.
RIGHT_ANGLES: tuple[FloatArray, ...] = tuple(
    matrix
    for order in permutations(range(3))
    for signs in product((1.0, -1.0), repeat=3)
    if np.linalg.det(matrix := np.diag(signs)[:, order]) > 0.0
)


@dataclass(frozen=True)
class Alignment:
    """Rotation and time offset of a camera relative to a gyroscope, as far as they are observable.

    Attributes:
        C_c_b: (3,3) body to camera rotation; about axes that are not observable, the calibrated one.
        sigma_deg: (3,) standard deviations about `axes`, ascending.
        axes: (3,3) axes of `sigma_deg` (columns, camera frame).
        offset_s: to be added to the camera clock; `offset_sigma_s` is its standard deviation.
        rates: (3,) root mean squares of the gyroscope [rad/s] along its principal axes, descending.
        leak: (3,) standard deviation of the camera's rate not explained by the gyroscope, by axis [rad/s].
        values: number of independent values of the leak.
        roll: (3,) standard deviations of the gyroscope's roll under the calibrated rotation, of the camera's
            roll, and of their difference [rad/s]. Translation does not cause an apparent roll.
        windows: number of windows of the camera.
        explained: fraction of the camera's rate (median square) explained by the gyroscope.
        scale: ratio of the camera's rate to the gyroscope's (median magnitudes).
        contradiction: log-likelihood by which the calibrated rotation is worse than the best.
        possible: indices in RIGHT_ANGLES of rotations of the calibrated one that the motion allows.
    """

    C_c_b: FloatArray
    sigma_deg: FloatArray
    axes: FloatArray
    offset_s: float
    offset_sigma_s: float
    rates: FloatArray
    leak: FloatArray
    values: float
    roll: FloatArray
    windows: int
    explained: float
    scale: float
    contradiction: float
    possible: tuple[int, ...]

    def error_deg(self, C_c_b: FloatArray, most_sigma_deg: float) -> float:
        """Angle [deg] of a claimed rotation (3,3) to the one found, about axes with at most this sigma."""
        turn = Rotation.from_matrix(self.C_c_b @ C_c_b.T).as_rotvec(degrees=True)
        return float(np.linalg.norm((self.axes.T @ turn)[self.sigma_deg <= most_sigma_deg]))

    @property
    def unrelated(self) -> bool:
        """Whether the two rolls, both fast, differ as much as independent ones would."""
        gyroscope, camera, difference = self.roll
        independent = np.hypot(gyroscope, camera)
        return bool(
            self.values > _LEAST_VALUES and gyroscope > _FAST_ROLL and difference > _UNRELATED * independent
        )

    def likelier_than(self, other: Alignment) -> float:
        """Log-likelihood by which this alignment explains the camera's rates better than the other."""
        return float(min(self.values, other.values) * np.log(other.leak / self.leak).sum())


def align(
    rates: CameraRates, gyroscope: RecordArray, claimed: FloatArray, around_s: float
) -> Alignment | None:
    """Fit rotation and offset; None if samples cover too few windows.

    Args:
        rates: rates of the camera, ascending.
        gyroscope: samples (INERTIAL_DTYPE), ascending, IMU clock.
        claimed: (3,3) body to camera rotation of the calibration; identity without one.
        around_s: calibrated offset; offsets around it and around its negative are tested.
    """
    if rates.count < LEAST_WINDOWS:
        return None
    turn = TurnOf(gyroscope)
    near = _align_near(rates, turn, claimed, around_s)
    if near is not None and near.explained > RELATED:
        return near
    far_s = find_far_offset(rates, turn, around_s)
    if far_s is None:
        return near
    far = _align_near(rates, turn, claimed, far_s)
    accepted = (
        far is not None
        and far.explained > RELATED
        and far.offset_sigma_s <= OFFSET_OBSERVABLE_S
        and (near is None or far.likelier_than(near) > CONTRADICTED + _OF_MANY)
    )
    return far if accepted else near


def _align_near(rates: CameraRates, turn: TurnOf, claimed: FloatArray, around_s: float) -> Alignment | None:
    """Rotation and offset, with the offset searched within about 0.1 s."""
    offset_s, sigma_s = find_offset(rates, turn, around_s)
    found = _align_at(rates, turn, claimed, offset_s, sigma_s)
    if found is None or found.offset_sigma_s > OFFSET_OBSERVABLE_S:
        # If translation dominates the motion, any offset may fit by chance.
        return _align_at(rates, turn, claimed, around_s, float("inf"))
    return found


def _align_at(
    rates: CameraRates, turn: TurnOf, claimed: FloatArray, offset_s: float, sigma_s: float
) -> Alignment | None:
    """Fit the rotation at a given offset with standard deviation `sigma_s`."""
    body, inside = turn.means(rates, offset_s)
    if np.count_nonzero(inside) < LEAST_WINDOWS:
        return None
    camera, body, gaps = rates.omega[inside], body[inside], gaps_of(rates, inside)
    noise = Noise(np.full(3, 0.1), np.zeros((len(gaps), 3)))
    fit = Fit(claimed, np.zeros(3), 0.0, np.eye(6))
    for _ in range(2):
        starts = [right @ fit.C for right in RIGHT_ANGLES]
        fits = [fit_rotation(camera, body, start, noise, _FEW_STEPS) for start in starts]
        fit = min(fits, key=lambda found: found.cost)
        noise = noise_of(camera - (body - fit.bias) @ fit.C.T, gaps)
    fit = nearest_fit(fit_rotation(camera, body, fit.C, noise), claimed, camera, body, noise)
    # The bias is not removed: a constant leak acts as a bias.
    residual = camera - body @ fit.C.T
    leak = _Leak(spread(residual), _LEAKS_HZ * float(np.ptp(rates.start_ns[inside])) / NS_PER_S)
    # Covariance of the rotation, marginal over the bias.
    covariance = np.linalg.inv(fit.normal)[:3, :3] + leak.of_rotation((body - fit.bias) @ fit.C.T)
    variances, axes = np.linalg.eigh(covariance)
    acceleration = _acceleration(turn, rates, offset_s)[inside] @ fit.C.T
    costs = np.array(
        [_negative_log_likelihood(camera, body, right @ claimed, leak.values) for right in RIGHT_ANGLES]
    )
    least = min(_negative_log_likelihood(camera, body, fit.C, leak.values), float(costs.min()))
    explained = 1.0 - np.median((residual**2).sum(axis=1)) / max(np.median((camera**2).sum(axis=1)), 1e-12)
    return Alignment(
        C_c_b=fit.C,
        sigma_deg=np.degrees(np.sqrt(variances)),
        axes=axes,
        offset_s=offset_s,
        offset_sigma_s=float(np.hypot(sigma_s, leak.of_offset(acceleration))),
        rates=np.linalg.svd(body, compute_uv=False) / np.sqrt(len(body)),
        leak=leak.sigma,
        values=leak.values,
        roll=np.concatenate([spread(roll) for roll in _rolls(camera, (body - fit.bias) @ claimed.T)]),
        windows=len(body),
        explained=float(explained),
        scale=_median_norm(camera) / max(_median_norm(body), 1e-12),
        contradiction=float(costs[0] - least),
        possible=tuple(int(k) for k in np.flatnonzero(costs < costs.min() + CONTRADICTED)),
    )


def _rolls(camera: FloatArray, claimed: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Rolls (N,1) of the gyroscope and of the camera, and their difference."""
    return claimed[:, 2:], camera[:, 2:], camera[:, 2:] - claimed[:, 2:]


def _negative_log_likelihood(camera: FloatArray, body: FloatArray, C: FloatArray, values: float) -> float:
    """Negative log-likelihood of a rotation with its best bias, for this number of independent values."""
    bias = np.median(body - camera @ C, axis=0)
    # Shrunk towards zero by the prior.
    noise = float(spread(camera - body @ C.T).max())
    bias *= BIAS_SIGMA**2 / (BIAS_SIGMA**2 + noise**2 / max(values, 1.0))
    left = spread(camera - (body - bias) @ C.T)
    return float(values * np.log(left).sum() + 0.5 * (bias**2).sum() / BIAS_SIGMA**2)


def _median_norm(vectors: FloatArray) -> float:
    return float(np.median(np.linalg.norm(vectors, axis=1)))


def _acceleration(turn: TurnOf, rates: CameraRates, offset_s: float) -> FloatArray:
    """Angular acceleration (N,3) of the body over the windows [rad/s^2]."""
    later, earlier = (turn.means(rates, offset_s + side * _DIFFERENCE_S)[0] for side in (1.0, -1.0))
    return np.asarray((later - earlier) / (2.0 * _DIFFERENCE_S))


@dataclass(frozen=True)
class _Leak:
    """Chance effect of a leak: standard deviations (3,) [rad/s] and number of independent values."""

    sigma: FloatArray
    values: float

    def of_rotation(self, predicted: FloatArray) -> FloatArray:
        """Covariance (3,3) of a rotation fitted to rates (N,3)."""
        rows = crosses(predicted)
        information = np.einsum("nji,j,njk->ik", rows, 1.0 / self.sigma**2, rows) / len(predicted)
        return np.asarray(np.linalg.inv(information * self.values + 1e-6 * np.eye(3)))

    def of_offset(self, acceleration: FloatArray) -> float:
        """Standard deviation [s] of an offset between rates with this angular acceleration (N,3)."""
        information = self.values * float(((acceleration / self.sigma) ** 2).sum(axis=1).mean())
        return float(1.0 / np.sqrt(max(information, 1e-12)))
