# SPDX-License-Identifier: Apache-2.0
"""The rays of the dead-reckoned adjustment from increments of the IMU."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from asyneio.inertial.increments import ImuWindow, Increments, SampleNoise
from asyneio.inertial.preintegration import midpoint
from asyneio.initialization.dead_reckoned_kernels import Rays
from asyneio.types import FloatArray, IntArray


@dataclass(frozen=True)
class SpanObservations:
    """Observations of a span: `t` (M,) seconds after its start, `track` (M,) 0..L-1, `xy` (M,2) normalised,
    `root_information` (M,2,2)."""

    t: FloatArray
    track: IntArray
    xy: FloatArray
    root_information: FloatArray


class DeadReckoning:
    """The integrated IMU over a span, as a function of the biases.

    Args:
        window: the samples, in seconds after the start of the span.
        noise: of the samples.
        T_b_c: (4,4) camera to body.
        seen: observations; those of each track in ascending time.
    """

    def __init__(
        self, window: ImuWindow, noise: SampleNoise, T_b_c: FloatArray, seen: SpanObservations
    ) -> None:
        self._window, self._noise = window, noise
        self._C_bc, self._r_bc = T_b_c[:3, :3], T_b_c[:3, 3]
        self._seen = seen
        samples = window.gyroscope_t, window.gyroscope
        self._rate = np.stack([np.interp(seen.t, samples[0], axis) for axis in samples[1].T], axis=1)
        order = np.argsort(seen.track, kind="stable")
        count = np.bincount(seen.track)
        # A track is parametrised at its middle observation, which is nearest to all others.
        self._reference = order[np.cumsum(count) - count + count // 2]

    def increments(self, t: FloatArray, bias: FloatArray) -> Increments:
        """Increments at `t` (N,) seconds after the start of the span."""
        return midpoint(self._window, bias, self._noise).at(t)

    def rays(self, bias: FloatArray) -> Rays:
        """The rays of all observations, dead-reckoned with biases (6,) [b_g, b_a].

        The camera's centre is `r + C r_bc`. An angle `phi` on the right of C moves it by `-C [r_bc]x phi`; in
        time it moves by `nu + C (omega x r_bc)`, in addition to velocity and gravity.
        """
        seen = self._seen
        at = self.increments(seen.t, bias)
        d_phi = at.d_bias[:, :3, :3]
        omega = self._rate - bias[:3]
        in_time = at.nu + np.einsum("nij,nj->ni", at.C, np.cross(omega, self._r_bc))
        d_centre = np.concatenate([at.d_bias[:, 6:], in_time[:, :, None]], axis=2)
        x, y, z = self._r_bc
        lever = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
        d_centre[:, :, :3] -= at.C @ lever @ d_phi
        return Rays(
            seen.t,
            np.ascontiguousarray(self._C_bc.T @ at.C.transpose(0, 2, 1)),
            at.r + at.C @ self._r_bc,
            d_centre,
            np.ascontiguousarray(self._C_bc.T @ np.concatenate([d_phi, omega[:, :, None]], axis=2)),
            seen.xy,
            seen.root_information,
            seen.track,
            self._reference,
        )
