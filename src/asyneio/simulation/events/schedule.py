# SPDX-License-Identifier: Apache-2.0
"""Times of rendering, such that the image moves by less than a pixel between two renderings.

Each tile of the image has its own stride, so that near or moving objects do not slow down the rest of the
image.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import maximum_filter

from asyneio.simulation.events.planes import NEAR_M
from asyneio.simulation.events.view import View
from asyneio.simulation.events.world import World
from asyneio.simulation.motion import Motion
from asyneio.types import BoolArray, FloatArray, IntArray

#: Angular velocity [rad/s] and velocity [m/s] of a camera in its own frame, (N,3) each.
Twist = tuple[FloatArray, FloatArray]

#: Depths are evaluated once for a block of this length; speeds are evaluated on the lattice.
BLOCK_US = 16_000
_LATTICE_US = 1_000
#: Safety factor for changes of depth within a block and of speed between lattice points.
_SAFETY = 1.08


@dataclass(frozen=True)
class Schedule:
    """Times of rendering in a block.

    Attributes:
        t_us: (N,) times [us], ascending; the last one is the end of the block.
        stride: (J,) a tile is rendered at every stride-th of these times and at the last.
    """

    t_us: IntArray
    stride: IntArray


def plan_block(
    motion: Motion,
    T_b_c: FloatArray,
    world: World,
    view: View,
    inverse_depth: FloatArray,
    span_us: tuple[int, int],
    largest_step_px: float,
    longest_step_us: int,
) -> Schedule:
    """Times of rendering of each tile in a block of time.

    Args:
        motion: motion of the body.
        T_b_c: (4,4) pose of the camera on the body.
        world: world with its moving bodies.
        view: rays of the camera.
        inverse_depth: (J,) inverse depth of the nearest point of each tile at the start of the block [1/m].
        span_us: start and end of the block [us].
        largest_step_px: maximum image motion between two renderings [px].
        longest_step_us: maximum time between two renderings [us].
    """
    begin, end = span_us
    lattice_us = np.linspace(begin, end, max(2, (end - begin) // _LATTICE_US + 1))
    # Points in a neighbouring tile may enter the tile before the block ends.
    reachable = _spread(inverse_depth, view)
    t_s = lattice_us * 1e-6
    camera = _camera_twist(motion, T_b_c, t_s)
    speed = _speeds(camera, view, reachable)
    T_w_c = motion.T_w_b(t_s) @ T_b_c
    poses = world.seen_from(t_s, T_w_c)
    for body, own in enumerate(world.motions, start=1):
        inside, nearest = _extent(poses[:, body], world.corners_of(body), view)
        relative = _relative_twist(camera, T_w_c, own, t_s)
        of_body = _speeds(relative, view, np.maximum(reachable, nearest))
        speed[:, inside] = np.maximum(speed[:, inside], of_body[:, inside])
    speed = np.maximum(_SAFETY * speed * 1e-6 / largest_step_px, 1.0 / longest_step_us)
    speed = np.maximum(speed[1:], speed[:-1])
    # Progress in steps: it grows by one when the fastest tile needs the next rendering.
    fastest = speed.max(axis=1)
    progress = np.concatenate([[0.0], np.cumsum(fastest * np.diff(lattice_us))])
    marks = np.linspace(0.0, progress[-1], int(np.ceil(progress[-1])) + 1)[1:]
    times = np.floor(np.interp(marks, progress, lattice_us)).astype(np.int64)
    times[-1] = end
    stride = np.floor(1.0 / (speed / fastest[:, None]).max(axis=0)).astype(np.int64)
    return Schedule(np.unique(times[times > begin]), np.maximum(stride, 1))


def _spread(of_tiles: FloatArray, view: View) -> FloatArray:
    """Maximum over each tile and its neighbours (J,)."""
    grid = of_tiles.reshape(view.tile_rows, -1)
    return np.asarray(maximum_filter(grid, size=3, mode="nearest")).ravel()


def _camera_twist(motion: Motion, T_b_c: FloatArray, t_s: FloatArray) -> Twist:
    """Twist of the camera in the world."""
    C_b_c, p_b_c = T_b_c[:3, :3], T_b_c[:3, 3]
    omega_b = motion.angular_velocity_b(t_s)
    C_w_b = motion.T_w_b(t_s)[:, :3, :3]
    velocity_b = np.einsum("nji,nj->ni", C_w_b, motion.velocity_w(t_s)) + np.cross(omega_b, p_b_c)
    return omega_b @ C_b_c, velocity_b @ C_b_c


def _relative_twist(camera: Twist, T_w_c: FloatArray, body: Motion, t_s: FloatArray) -> Twist:
    """Twist of the camera at `T_w_c` (N,4,4) relative to a moving body."""
    T_w_o = body.T_w_b(t_s)
    omega_w = np.einsum("nij,nj->ni", T_w_o[:, :3, :3], body.angular_velocity_b(t_s))
    lever_w = T_w_c[:, :3, 3] - T_w_o[:, :3, 3]
    carried_w = body.velocity_w(t_s) + np.cross(omega_w, lever_w)
    C_c_w = T_w_c[:, :3, :3].transpose(0, 2, 1)
    return (
        camera[0] - np.einsum("nij,nj->ni", C_c_w, omega_w),
        camera[1] - np.einsum("nij,nj->ni", C_c_w, carried_w),
    )


def _extent(T_o_c: FloatArray, corners_o: FloatArray, view: View) -> tuple[BoolArray, float]:
    """Tiles (J,) in which a body may be visible during a block, and inverse depth of its nearest point [1/m].

    `T_o_c` (N,4,4): camera poses in the body frame on the lattice; `corners_o` (K,3): corners of its
    rectangles.
    """
    points_c = np.einsum("nji,nkj->nki", T_o_c[:, :3, :3], corners_o - T_o_c[:, None, :3, 3])
    depth = points_c[..., 2]
    if np.all(depth < NEAR_M):
        return np.zeros(len(view.tiles), dtype=bool), 0.0
    if np.any(depth < NEAR_M):
        # The body extends behind the camera: it may be visible anywhere.
        return np.ones(len(view.tiles), dtype=bool), 1.0 / NEAR_M
    rays = (points_c[..., :2] / depth[..., None]).reshape(-1, 2)
    low, high = rays.min(axis=0), rays.max(axis=0)
    inside = np.all((view.tiles[:, 2:] >= low) & (view.tiles[:, :2] <= high), axis=1)
    # Neighbours too: borders are blended over a pixel, and the body moves between lattice points.
    return _spread(inside.astype(np.float64), view) > 0.0, 1.0 / float(depth.min())


def _speeds(twist: Twist, view: View, inverse_depth: FloatArray) -> FloatArray:
    """Image speed (N,J) [px/s] of the centre of each tile for N twists."""
    wx, wy, wz = twist[0].T[:, :, None]
    vx, vy, vz = twist[1].T[:, :, None]
    x, y = 0.5 * (view.tiles[:, :2] + view.tiles[:, 2:]).T
    flow_x = inverse_depth * (x * vz - vx) + x * y * wx - (1.0 + x * x) * wy + y * wz
    flow_y = inverse_depth * (y * vz - vy) + (1.0 + y * y) * wx - x * y * wy - x * wz
    return np.asarray(np.hypot(flow_x, flow_y) / view.tile_pitch)
