"""When to render: so often that the image moves by less than a pixel from one rendering to the next.

Each tile of the image has its own pace: a far wall need not wait for the corner of a near box.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import maximum_filter

from asyneio.simulation.events.view import View
from asyneio.simulation.motion import Motion
from asyneio.types import FloatArray, IntArray

#: Depths are looked up once for this long; speeds are followed on the lattice.
BLOCK_US = 16_000
_LATTICE_US = 1_000
#: Depths, and the speed between lattice points, may change by this much within a block.
_SAFETY = 1.08


@dataclass(frozen=True)
class Schedule:
    """When to render: `t_us` (N,) ascending, the last one the end of the block; `stride` (J,): a tile is
    rendered at every stride-th of them and at the last."""

    t_us: IntArray
    stride: IntArray


def plan_block(
    motion: Motion,
    T_b_c: FloatArray,
    view: View,
    inverse_depth: FloatArray,
    span_us: tuple[int, int],
    largest_step_px: float,
    longest_step_us: int,
) -> Schedule:
    """When to render which tile in a block of time, both ends in `span_us`, after its start.

    Args:
        motion: of the body; `T_b_c` (4,4) mounts the camera on it.
        view: of the camera.
        inverse_depth: (J,) [1/m] of the nearest point in each tile of the view, at the start of the block.
        largest_step_px: how far the image may move in between.
        longest_step_us: how long it may take in between.
    """
    begin, end = span_us
    lattice_us = np.linspace(begin, end, max(2, (end - begin) // _LATTICE_US + 1))
    # What is in a tile's neighbour now may be in the tile before the block ends.
    reachable = maximum_filter(inverse_depth.reshape(view.tile_rows, -1), size=3, mode="nearest").ravel()
    speed = _SAFETY * _speeds(motion, T_b_c, view, reachable, lattice_us * 1e-6)
    speed = np.maximum(speed * 1e-6 / largest_step_px, 1.0 / longest_step_us)
    speed = np.maximum(speed[1:], speed[:-1])
    # Progress counts steps: it grows by one whenever the fastest tile has moved, or time has passed, enough.
    fastest = speed.max(axis=1)
    progress = np.concatenate([[0.0], np.cumsum(fastest * np.diff(lattice_us))])
    marks = np.linspace(0.0, progress[-1], int(np.ceil(progress[-1])) + 1)[1:]
    times = np.floor(np.interp(marks, progress, lattice_us)).astype(np.int64)
    times[-1] = end
    stride = np.floor(1.0 / (speed / fastest[:, None]).max(axis=0)).astype(np.int64)
    return Schedule(np.unique(times[times > begin]), np.maximum(stride, 1))


def _speeds(
    motion: Motion, T_b_c: FloatArray, view: View, inverse_depth: FloatArray, t_s: FloatArray
) -> FloatArray:
    """Speed in the image (N,J) [px/s] of the centre of each tile at times (N,)."""
    C_b_c, p_b_c = T_b_c[:3, :3], T_b_c[:3, 3]
    omega_b = motion.angular_velocity_b(t_s)
    C_w_b = motion.T_w_b(t_s)[:, :3, :3]
    velocity_b = np.einsum("nji,nj->ni", C_w_b, motion.velocity_w(t_s)) + np.cross(omega_b, p_b_c)
    wx, wy, wz = (omega_b @ C_b_c).T[:, :, None]
    vx, vy, vz = (velocity_b @ C_b_c).T[:, :, None]
    x, y = 0.5 * (view.tiles[:, :2] + view.tiles[:, 2:]).T
    flow_x = inverse_depth * (x * vz - vx) + x * y * wx - (1.0 + x * x) * wy + y * wz
    flow_y = inverse_depth * (y * vz - vy) + (1.0 + y * y) * wx - x * y * wy - x * wz
    return np.asarray(np.hypot(flow_x, flow_y) / view.tile_pitch)
