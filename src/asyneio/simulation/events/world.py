# SPDX-License-Identifier: Apache-2.0
"""A world of textured rectangles, some of which may move as rigid bodies of their own."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from asyneio.simulation.events.pyramid import Pyramids
from asyneio.simulation.motion import Motion
from asyneio.types import FloatArray, IntArray


@dataclass(frozen=True)
class World:
    """Rectangles `corner + s edge_u + t edge_v`, 0 <= s, t <= 1, one texture each.

    Attributes:
        corner, edge_u, edge_v: (R,3) [m] in the frame of their body; the edges are perpendicular.
        pyramids: textures.
        free_low, free_high: (3,) [m] bounds of the space without static objects, for the camera.
        motions: motions of the moving bodies.
        body: (R,) body of each rectangle: 0 is the static world, `b` the body with `motions[b - 1]`.
    """

    corner: FloatArray
    edge_u: FloatArray
    edge_v: FloatArray
    pyramids: Pyramids
    free_low: FloatArray
    free_high: FloatArray
    motions: tuple[Motion, ...] = ()
    body: IntArray = field(default_factory=lambda: np.zeros(0, dtype=np.int64))

    def __post_init__(self) -> None:
        if self.body.size != len(self.corner):
            # All rectangles are static.
            object.__setattr__(self, "body", np.zeros(len(self.corner), dtype=np.int64))

    def seen_from(self, t_s: FloatArray, T_w_c: FloatArray) -> FloatArray:
        """Camera poses (N,B,4,4) in the frames of the world and of each moving body, given poses (N,4,4) in
        the world at times (N,) [s]."""
        poses = np.empty((len(T_w_c), 1 + len(self.motions), 4, 4))
        poses[:, 0] = T_w_c
        for index, motion in enumerate(self.motions, start=1):
            T_w_o = motion.T_w_b(t_s)
            C_o_w = T_w_o[:, :3, :3].transpose(0, 2, 1)
            poses[:, index] = T_w_c
            poses[:, index, :3, :3] = C_o_w @ T_w_c[:, :3, :3]
            poses[:, index, :3, 3] = np.einsum("nij,nj->ni", C_o_w, T_w_c[:, :3, 3] - T_w_o[:, :3, 3])
        return poses

    def corners_of(self, body: int) -> FloatArray:
        """Corners (4R',3) [m] of the rectangles of a body, in its own frame."""
        mine = self.body == body
        corner, u, v = self.corner[mine], self.edge_u[mine], self.edge_v[mine]
        return np.concatenate([corner, corner + u, corner + v, corner + u + v])
