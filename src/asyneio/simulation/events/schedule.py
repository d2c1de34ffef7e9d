"""When to render: so often that the image moves by less than a pixel from one rendering to the next."""

from __future__ import annotations

import numpy as np

from asyneio.simulation.events.render import View
from asyneio.simulation.motion import Motion
from asyneio.types import FloatArray, IntArray

#: Depths are looked up once for this long; speeds are followed on the lattice.
BLOCK_US = 16_000
_LATTICE_US = 1_000
#: Depths, and the speed between lattice points, may change by this much within a block.
_SAFETY = 1.08


def render_times(
    motion: Motion,
    T_b_c: FloatArray,
    view: View,
    inverse_depth: FloatArray,
    start_us: int,
    end_us: int,
    largest_step_px: float,
    longest_step_us: int,
) -> IntArray:
    """Times (N,) [us] at which to render next, after `start_us` and up to `end_us`, which is the last.

    Args:
        motion: of the body; `T_b_c` (4,4) mounts the camera on it.
        view: of the camera.
        inverse_depth: (J,) [1/m] of the nearest point in each tile of the view, at `start_us`.
        largest_step_px: how far the image may move in between.
        longest_step_us: how long it may take in between.
    """
    count = max(2, (end_us - start_us) // _LATTICE_US + 1)
    lattice_us = np.linspace(start_us, end_us, count)
    speed = _SAFETY * _fastest(motion, T_b_c, view, inverse_depth, lattice_us * 1e-6)
    # Progress counts steps: it grows by one whenever the image has moved, or time has passed, enough.
    rate = np.maximum(speed * 1e-6 / largest_step_px, 1.0 / longest_step_us)
    rate = np.maximum(rate[1:], rate[:-1])
    progress = np.concatenate([[0.0], np.cumsum(rate * np.diff(lattice_us))])
    steps = int(np.ceil(progress[-1]))
    marks = np.linspace(0.0, progress[-1], steps + 1)[1:]
    times = np.floor(np.interp(marks, progress, lattice_us)).astype(np.int64)
    times[-1] = end_us
    return np.unique(times[times > start_us])


def _fastest(
    motion: Motion, T_b_c: FloatArray, view: View, inverse_depth: FloatArray, t_s: FloatArray
) -> FloatArray:
    """The largest speed in the image (N,) [px/s] at times (N,), over the centres of all tiles."""
    C_b_c, p_b_c = T_b_c[:3, :3], T_b_c[:3, 3]
    omega_b = motion.angular_velocity_b(t_s)
    C_w_b = motion.T_w_b(t_s)[:, :3, :3]
    velocity_b = np.einsum("nji,nj->ni", C_w_b, motion.velocity_w(t_s)) + np.cross(omega_b, p_b_c)
    wx, wy, wz = (omega_b @ C_b_c).T[:, :, None]
    vx, vy, vz = (velocity_b @ C_b_c).T[:, :, None]
    x, y = 0.5 * (view.tiles[:, :2] + view.tiles[:, 2:]).T
    flow_x = inverse_depth * (x * vz - vx) + x * y * wx - (1.0 + x * x) * wy + y * wz
    flow_y = inverse_depth * (y * vz - vy) + (1.0 + y * y) * wx - x * y * wy - x * wz
    return np.asarray((np.hypot(flow_x, flow_y) / view.tile_pitch).max(axis=1))
