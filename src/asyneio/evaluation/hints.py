# SPDX-License-Identifier: Apache-2.0
"""Possible causes of a large error: a unit, clocks, another body frame, a rotated or mirrored world.

The hints are messages for errors that a single common mistake would explain.

| symbol | name | shape | frame |
|---|---|---|---|
| C_e, C_w | attitudes of estimate and truth at common times | (N,3,3) | body to world |
| B | body of the truth in that of the estimate, `C_w = A C_e B` | (3,3) | |
"""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from asyneio.evaluation.alignment import Similarity
from asyneio.evaluation.association import Association
from asyneio.types import NS_PER_S, FloatArray

#: Factors between commonly confused units of length, and tolerance of the ratio.
_FACTORS = {1000.0: "millimetres", 100.0: "centimetres"}
_NEAR = 1.15
#: Minimum rotation for a hint [deg], and fraction of it that must be common to all poses.
_LEAST_DEG, _STEADY = 10.0, 0.25
#: Maximum angle between the verticals of two upright worlds [deg].
_UPRIGHT_DEG = 5.0
#: Minimum factor by which the reordered quaternion must reduce the error.
_BETTER = 4.0
#: Smallest error of the positions that is explained, as a share of their spread.
_LEAST_DISTANCE = 0.05
#: Offsets that are tried [s], their smallest step [s], and the largest number of positions.
_MOST_OFFSET_S, _OFFSET_STEP_S, _MOST_STEPS = 30.0, 0.05, 2000


def explain(matched: Association, alignment: Similarity, order_known: bool = True) -> tuple[str, ...]:
    """Messages on mistakes that would explain a difference of estimate and ground truth; none for small ones.

    Args:
        matched: estimate and ground truth at common times.
        alignment: fitted alignment of the estimate.
        order_known: false if no header gives the order of the quaternions, so that w may be first.
    """
    if matched.t_ns.size < 3:
        return ()
    turned = () if order_known else _of_order(matched, alignment)
    turned = turned or _of_inverse(matched, alignment)
    placed = _of_scale(matched) or _of_path(matched)
    return placed + (turned or _of_rotation(matched, alignment))


def _of_path(matched: Association) -> tuple[str, ...]:
    """A message if a mirrored world or an offset of the clocks explains the positions."""
    estimate, truth = matched.estimate.position, matched.truth.position
    error, size = _distance(estimate, truth), _spread(truth)
    if error < _LEAST_DISTANCE * size:
        return ()
    if _distance(estimate * [1.0, -1.0, 1.0], truth) < error / _BETTER:
        return (
            "the positions agree if one world is mirrored: the axes of estimate or ground truth are "
            "left-handed (two exchanged, or one inverted); export right-handed axes",
        )
    offset_s, least = _offset(matched)
    if least < error / _BETTER:
        return (
            f"the positions agree if about {offset_s:.2f} s are added to the timestamps of the estimate: the "
            "clocks of estimate and ground truth differ",
        )
    return ()


def _offset(matched: Association) -> tuple[float, float]:
    """The offset [s] to add to the stamps of the estimate with the smallest distance, and the latter [m]."""
    t_s = (matched.t_ns - matched.t_ns[0]) / NS_PER_S
    step = max(_OFFSET_STEP_S, float(t_s[-1]) / _MOST_STEPS)
    grid = np.arange(0.0, float(t_s[-1]), step)
    estimate, truth = (
        np.stack([np.interp(grid, t_s, axis) for axis in track.position.T], axis=1)
        for track in (matched.estimate, matched.truth)
    )
    most = min(round(_MOST_OFFSET_S / step), len(grid) // 3)
    best = (float("inf"), 0)
    for lag in range(-most, most + 1):
        n = len(grid) - abs(lag)
        first, second = max(-lag, 0), max(lag, 0)
        best = min(best, (_distance(estimate[first : first + n], truth[second : second + n]), lag))
    return best[1] * step, best[0]


def _distance(estimate: FloatArray, truth: FloatArray) -> float:
    """Root mean square distance of positions (N,3) after the best rotation and translation [m]."""
    if len(estimate) < 3:
        return float("inf")
    p, w = estimate - estimate.mean(axis=0), truth - truth.mean(axis=0)
    u, s, v = np.linalg.svd(p.T @ w)
    trace = s.sum() - (2.0 * s[2] if np.linalg.det(u @ v) < 0.0 else 0.0)
    return float(np.sqrt(max((p**2).sum() + (w**2).sum() - 2.0 * trace, 0.0) / len(p)))


def _of_inverse(matched: Association, alignment: Similarity) -> tuple[str, ...]:
    """A message if inverted orientations (world to body) explain the difference."""
    estimate, truth, R = matched.estimate.C, matched.truth.C, alignment.R
    told = _common((R @ estimate).transpose(0, 2, 1) @ truth)[1]
    if told < _LEAST_DEG:
        return ()
    inverted = estimate.transpose(0, 2, 1), truth.transpose(0, 2, 1)
    for what, C_e, C_w in (("estimate", inverted[0], truth), ("ground truth", estimate, inverted[1])):
        if _common((R @ C_e).transpose(0, 2, 1) @ C_w)[1] < told / _BETTER:
            return (
                f"the orientations agree if those of the {what} are inverted: it contains rotations of the "
                "world into the body; expected body to world",
            )
    return ()


def _of_scale(matched: Association) -> tuple[str, ...]:
    sizes = [_spread(track.position) for track in (matched.estimate, matched.truth)]
    if min(sizes) <= 0.0:
        return ()
    ratio, larger = max(sizes) / min(sizes), "estimate" if sizes[0] > sizes[1] else "truth"
    for factor, unit in _FACTORS.items():
        if factor / _NEAR < ratio < factor * _NEAR:
            return (
                f"the path of the {larger} is {ratio:.4g} times as large as the other: is the {larger} "
                f"in {unit}? "
                "Both are taken to be in metres",
            )
    return ()


def _of_rotation(matched: Association, alignment: Similarity) -> tuple[str, ...]:
    aligned = alignment.R @ matched.estimate.C
    in_body, spread_b = _common(aligned.transpose(0, 2, 1) @ matched.truth.C)
    in_world, spread_w = _common(matched.truth.C @ matched.estimate.C.transpose(0, 2, 1))
    tilt = float(np.degrees(np.arccos(np.clip(in_world.as_matrix()[2, 2], -1.0, 1.0))))
    angle = float(np.degrees(in_body.magnitude()))
    if angle < _LEAST_DEG:
        return ()
    if spread_w < _STEADY * _LEAST_DEG and spread_w <= spread_b and tilt > _UPRIGHT_DEG:
        return (
            f"the worlds of estimate and truth differ by a constant rotation, which tilts the vertical by "
            f"{tilt:.1f} deg: z is not up in one of them; --protocol se3 aligns it",
        )
    if spread_b < _STEADY * angle:
        axis = ", ".join(f"{value:.1f}" for value in in_body.as_rotvec(degrees=True))
        return (
            f"all orientations differ by a constant rotation of {angle:.1f} deg in the body frame, "
            "rotation vector "
            f"({axis}) deg: is one of them that of the camera, or of markers, instead of the IMU? The "
            "orientation "
            "errors compare these frames",
        )
    return ()


def _of_order(matched: Association, alignment: Similarity) -> tuple[str, ...]:
    """A message if a quaternion with w at the other end explains the orientations."""
    estimate, truth, R = matched.estimate.C, matched.truth.C, alignment.R
    told = _common((R @ estimate).transpose(0, 2, 1) @ truth)[1]
    if told < _LEAST_DEG:
        return ()
    for what, C_e, C_w in (("estimate", _reordered(estimate), truth), ("truth", estimate, _reordered(truth))):
        if _common((R @ C_e).transpose(0, 2, 1) @ C_w)[1] < told / _BETTER:
            return (
                f"the orientations agree if w is first in the quaternions of the {what}, whose order no "
                "header tells: "
                f"name its columns ({'--columns' if what == 'estimate' else '--truth-columns'} "
                "t,px,py,pz,qw,qx,qy,qz)",
            )
    return ()


def _reordered(C: FloatArray) -> FloatArray:
    """Rotations (N,3,3) for quaternions with w first that were read with w last."""
    return np.asarray(Rotation.from_quat(np.roll(Rotation.from_matrix(C).as_quat(), -1, axis=1)).as_matrix())


def _common(rotations: FloatArray) -> tuple[Rotation, float]:
    """The mean of rotations (N,3,3), and the median angle from it [deg]."""
    mean = Rotation.from_matrix(rotations).mean()
    from_it = (mean.inv() * Rotation.from_matrix(rotations)).magnitude()
    return mean, float(np.degrees(np.median(from_it)))


def _spread(position: FloatArray) -> float:
    return float(np.sqrt(((position - position.mean(axis=0)) ** 2).sum(axis=1).mean()))
