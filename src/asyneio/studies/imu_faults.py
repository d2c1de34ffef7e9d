# SPDX-License-Identifier: Apache-2.0
"""Loss of inertial samples: single samples, or all samples of short gaps."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from asyneio.types import NS_PER_S, RecordArray, Recording


def lose_samples(recording: Recording, share: float, rng: np.random.Generator) -> Recording:
    """The recording without a random share of the samples of each sensor."""
    kept = [samples[rng.random(samples.size) >= share] for samples in _streams(recording)]
    return replace(recording, gyroscope=kept[0], accelerometer=kept[1])


def lose_bursts(recording: Recording, share: float, length_s: float, rng: np.random.Generator) -> Recording:
    """The recording without the samples of both sensors in gaps of `length_s`, which are a share of its
    duration.

    The recording is divided into equal parts with one gap each, at a random position except for a margin of a
    tenth of the part, so gaps do not touch.
    """
    streams = _streams(recording)
    start_ns, end_ns = int(streams[0]["t_ns"][0]), int(streams[0]["t_ns"][-1])
    part_ns, length_ns = length_s / share * NS_PER_S, length_s * NS_PER_S
    parts = np.arange(int((end_ns - start_ns) / part_ns))
    room_ns = 0.8 * part_ns - length_ns
    begin_ns = start_ns + part_ns * (parts + 0.1) + room_ns * rng.uniform(size=parts.size)
    kept = []
    for samples in streams:
        gap = np.searchsorted(begin_ns, samples["t_ns"], side="right") - 1
        lost = (gap >= 0) & (samples["t_ns"] - begin_ns[gap] < length_ns)
        kept.append(samples[~lost])
    return replace(recording, gyroscope=kept[0], accelerometer=kept[1])


def _streams(recording: Recording) -> tuple[RecordArray, RecordArray]:
    return recording.gyroscope, recording.accelerometer
