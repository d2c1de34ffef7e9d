"""Rotation and time offset between two sources of angular velocity: the camera's motion and a gyroscope.

Model: `omega_c(t) = C_c_b (omega_b(t + offset) - bias) + leak`, windows of the camera compared with means
of the gyroscope over the same time. The leak is what a translation of the camera does to an estimate that
knows rotations only: mostly a turn about x and y, and slow. So each axis has a noise of its own, in which
neighbours are alike (autoregressive of order 1); both are found from what is left over, and the fit is made
on innovations: what differs from one window to the next. The bias is held near zero: where the camera turns
about one axis at a steady rate, bias and rotation cannot be told apart.

1. *Offset.* For each trial the best linear map `omega_c = A omega_b + a` by robust least squares; its
   innovations are least at the true offset, whatever the rotation, be it even a reflection or a wrong unit.
2. *Rotation and bias.* Robust Gauss-Newton from the rotation the calibration claims and from each of its 23
   neighbours by right angles; the least cost wins.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import permutations, product

import numpy as np
from scipy.spatial.transform import Rotation

from asyneio.doctor.rotation.camera_rates import CameraRates
from asyneio.doctor.rotation.fit import BIAS_SIGMA, Fit, crosses, fit_rotation, nearest_fit
from asyneio.doctor.rotation.noise import Noise, noise_of, spread
from asyneio.doctor.rotation.time_offset import LEAST_WINDOWS, TurnOf, find_far_offset, find_offset, gaps_of
from asyneio.types import NS_PER_S, FloatArray, RecordArray

#: Steps from those starts of which one is taken.
_FEW_STEPS = 6
#: Independent values of a leak in a second: hands and vehicles change their velocity about as often. A leak
#: that goes with the rotation by chance passes for one; innovations see only part of it.
_LEAKS_HZ = 4.0
#: Half the time over which angular accelerations are taken [s].
_SWING_S = 0.01
#: Log-likelihood that a rotation must lack to be contradicted: chance brings it once in a million.
CONTRADICTED = 15.0
#: An offset known no better than this [s] is not told, and the claimed one is used.
OFFSET_TOLD_S = 0.008

#: Rolls are unrelated where they differ by this share of what independent ones would; and are fast from this
#: rate [rad/s] on. Fewer independent values tell neither.
_UNRELATED, _FAST_ROLL, _LEAST_VALUES = 0.75, 0.15, 8.0
#: Share of the camera's rate from which on both see one motion.
RELATED = 0.5
#: Logarithm of the number of offsets among which one is chosen.
_OF_MANY = 7.0

#: The 24 rotations that take axes to axes.
RIGHT_ANGLES: tuple[FloatArray, ...] = tuple(
    matrix
    for order in permutations(range(3))
    for signs in product((1.0, -1.0), repeat=3)
    if np.linalg.det(matrix := np.diag(signs)[:, order]) > 0.0
)


@dataclass(frozen=True)
class Alignment:
    """How a camera sits on a gyroscope, as far as the motion tells.

    Attributes:
        C_c_b: (3,3) body to camera directions; along directions that are not told, what was claimed.
        sigma_deg: (3,) standard deviations along `axes`, ascending.
        axes: (3,3) the directions (columns, camera frame) that they belong to.
        offset_s: to be added to the camera's clock; `offset_sigma_s` its standard deviation.
        rates: (3,) root mean squares of the gyroscope [rad/s] along its principal axes, descending.
        leak: (3,) spread of what the gyroscope does not explain of the camera's rate about its axes [rad/s].
        values: number of independent values of a leak.
        roll: (3,) spread of the roll of the gyroscope as mounted by the claim, of the camera's, and of their
            difference [rad/s]: no translation imitates a roll.
        windows: number of windows of the camera.
        explained: share of the camera's rate (its median square) that the gyroscope explains.
        scale: magnitude of the camera's rate over that of the gyroscope's (medians).
        contradiction: log-likelihood by which the claimed rotation falls short of the best.
        possible: indices in RIGHT_ANGLES of the turns of the claimed rotation that the motion allows.
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
        """Angle between a claimed rotation and the one found, about axes that are known this well."""
        turn = Rotation.from_matrix(self.C_c_b @ C_c_b.T).as_rotvec(degrees=True)
        return float(np.linalg.norm((self.axes.T @ turn)[self.sigma_deg <= most_sigma_deg]))

    @property
    def unrelated(self) -> bool:
        """Whether the two rolls, both fast, are as far apart as if they had nothing in common."""
        gyroscope, camera, difference = self.roll
        independent = np.hypot(gyroscope, camera)
        return bool(
            self.values > _LEAST_VALUES and gyroscope > _FAST_ROLL and difference > _UNRELATED * independent
        )

    def likelier_than(self, other: Alignment) -> float:
        """Log-likelihood by which this one explains the camera's rates better."""
        return float(min(self.values, other.values) * np.log(other.leak / self.leak).sum())


def align(
    rates: CameraRates, gyroscope: RecordArray, claimed: FloatArray, around_s: float
) -> Alignment | None:
    """Fit rotation and offset; None where too few windows are covered by samples.

    Args:
        rates: of the camera, ascending.
        gyroscope: INERTIAL_DTYPE, ascending, in its own clock.
        claimed: (3,3) body to camera directions of the calibration, identity where there is none.
        around_s: claimed offset, around which others are tried (and around its negative).
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
    believed = (
        far is not None
        and far.explained > RELATED
        and far.offset_sigma_s <= OFFSET_TOLD_S
        and (near is None or far.likelier_than(near) > CONTRADICTED + _OF_MANY)
    )
    return far if believed else near


def _align_near(rates: CameraRates, turn: TurnOf, claimed: FloatArray, around_s: float) -> Alignment | None:
    """Rotation and offset with the offset sought within a tenth of a second."""
    offset_s, sigma_s = find_offset(rates, turn, around_s)
    found = _align_at(rates, turn, claimed, offset_s, sigma_s)
    if found is None or found.offset_sigma_s > OFFSET_TOLD_S:
        # Where translation makes most of the motion, any offset may fit by chance.
        return _align_at(rates, turn, claimed, around_s, float("inf"))
    return found


def _align_at(
    rates: CameraRates, turn: TurnOf, claimed: FloatArray, offset_s: float, sigma_s: float
) -> Alignment | None:
    """Fit the rotation at a given offset, which is known to `sigma_s`."""
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
    # Without the bias: a steady leak passes for one.
    whole = camera - body @ fit.C.T
    leak = _Leak(spread(whole), _LEAKS_HZ * float(np.ptp(rates.start_ns[inside])) / NS_PER_S)
    # Of the rotation alone, whatever the bias is.
    covariance = np.linalg.inv(fit.normal)[:3, :3] + leak.of_rotation((body - fit.bias) @ fit.C.T)
    variances, axes = np.linalg.eigh(covariance)
    swing = _swing(turn, rates, offset_s)[inside] @ fit.C.T
    misfits = np.array([_misfit(camera, body, right @ claimed, leak.values) for right in RIGHT_ANGLES])
    least = min(_misfit(camera, body, fit.C, leak.values), float(misfits.min()))
    explained = 1.0 - np.median((whole**2).sum(axis=1)) / max(np.median((camera**2).sum(axis=1)), 1e-12)
    return Alignment(
        C_c_b=fit.C,
        sigma_deg=np.degrees(np.sqrt(variances)),
        axes=axes,
        offset_s=offset_s,
        offset_sigma_s=float(np.hypot(sigma_s, leak.of_offset(swing))),
        rates=np.linalg.svd(body, compute_uv=False) / np.sqrt(len(body)),
        leak=leak.sigma,
        values=leak.values,
        roll=np.concatenate([spread(roll) for roll in _rolls(camera, (body - fit.bias) @ claimed.T)]),
        windows=len(body),
        explained=float(explained),
        scale=_median_norm(camera) / max(_median_norm(body), 1e-12),
        contradiction=float(misfits[0] - least),
        possible=tuple(int(k) for k in np.flatnonzero(misfits < misfits.min() + CONTRADICTED)),
    )


def _rolls(camera: FloatArray, claimed: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Rolls (N,1) by the gyroscope and by the camera, and their difference."""
    return claimed[:, 2:], camera[:, 2:], camera[:, 2:] - claimed[:, 2:]


def _misfit(camera: FloatArray, body: FloatArray, C: FloatArray, values: float) -> float:
    """Negative log-likelihood of a rotation, as of so many independent values, with the bias it needs."""
    bias = np.median(body - camera @ C, axis=0)
    # Drawn to zero as far as the prior is the stronger one.
    noise = float(spread(camera - body @ C.T).max())
    bias *= BIAS_SIGMA**2 / (BIAS_SIGMA**2 + noise**2 / max(values, 1.0))
    left = spread(camera - (body - bias) @ C.T)
    return float(values * np.log(left).sum() + 0.5 * (bias**2).sum() / BIAS_SIGMA**2)


def _median_norm(vectors: FloatArray) -> float:
    return float(np.median(np.linalg.norm(vectors, axis=1)))


def _swing(turn: TurnOf, rates: CameraRates, offset_s: float) -> FloatArray:
    """Angular acceleration (N,3) of the body over the windows [rad/s^2]."""
    later, earlier = (turn.means(rates, offset_s + side * _SWING_S)[0] for side in (1.0, -1.0))
    return np.asarray((later - earlier) / (2.0 * _SWING_S))


@dataclass(frozen=True)
class _Leak:
    """What a leak of `sigma` (3,) [rad/s], with so many independent values in all, may do by chance."""

    sigma: FloatArray
    values: float

    def of_rotation(self, predicted: FloatArray) -> FloatArray:
        """Covariance (3,3) of a rotation that is fitted to rates (N,3)."""
        rows = crosses(predicted)
        information = np.einsum("nji,j,njk->ik", rows, 1.0 / self.sigma**2, rows) / len(predicted)
        return np.asarray(np.linalg.inv(information * self.values + 1e-6 * np.eye(3)))

    def of_offset(self, swing: FloatArray) -> float:
        """Standard deviation [s] of an offset between rates that change so (N,3)."""
        information = self.values * float(((swing / self.sigma) ** 2).sum(axis=1).mean())
        return float(1.0 / np.sqrt(max(information, 1e-12)))
