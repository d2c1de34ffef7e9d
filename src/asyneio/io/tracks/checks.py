# SPDX-License-Identifier: Apache-2.0
"""Checks and repairs of feature tracks: duplicates, sensor border, cutting into shorter tracks."""

from __future__ import annotations

import numpy as np

from asyneio.errors import RecordingError
from asyneio.io.parsing.stamp_checks import MAX_BAD_SHARE
from asyneio.types import NS_PER_S, CameraIntrinsics, RecordArray

#: The centre of the first pixel is at 0 or at 0.5, depending on the convention; both are inside.
_BORDER_PX = 1.0
#: 2^64 divided by the golden ratio: its multiples modulo 2^64 are evenly distributed (Weyl sequence).
_GOLDEN = np.uint64(11400714819323198485)


def drop_outside(rows: RecordArray, camera: CameraIntrinsics) -> tuple[RecordArray, tuple[str, ...]]:
    """Drop observations outside the sensor, with a note.

    Raises:
        RecordingError: more than MAX_BAD_SHARE of them are outside.
    """
    inside = (
        (rows["u"] >= -_BORDER_PX)
        & (rows["u"] <= camera.width - 1 + _BORDER_PX)
        & (rows["v"] >= -_BORDER_PX)
        & (rows["v"] <= camera.height - 1 + _BORDER_PX)
    )
    outside = int(rows.size - inside.sum())
    if outside == 0:
        return rows, ()
    if outside > MAX_BAD_SHARE * rows.size:
        raise RecordingError(
            f"{outside} of {rows.size} observations are outside the {camera.width} x {camera.height} sensor "
            f"(u up to {rows['u'].max():.1f}, v up to {rows['v'].max():.1f}): wrong resolution in the "
            "calibration, or u and v exchanged?"
        )
    return rows[inside], (f"tracks: dropped {outside} observation(s) outside the sensor",)


def drop_repeated(rows: RecordArray) -> tuple[RecordArray, tuple[str, ...]]:
    """Keep the first of observations with the same id and time (rows ascending in time), with a note.

    Raises:
        RecordingError: more than MAX_BAD_SHARE of them are duplicates.
    """
    order = np.lexsort((rows["id"], rows["t_ns"]))
    t_ns, ids = rows["t_ns"][order], rows["id"][order]
    repeats = np.zeros(rows.size, dtype=bool)
    repeats[order[1:]] = (t_ns[1:] == t_ns[:-1]) & (ids[1:] == ids[:-1])
    count = int(repeats.sum())
    if count == 0:
        return rows, ()
    if count > MAX_BAD_SHARE * rows.size:
        raise RecordingError(
            f"{count} of {rows.size} observations repeat an id at the same time; features observed at the "
            "same time need different ids (two cameras or two recordings in one file?)"
        )
    return rows[~repeats], (f"tracks: dropped {count} duplicate observation(s)",)


def cut_tracks(rows: RecordArray, max_seconds: float) -> RecordArray:
    """Cut every track into pieces shorter than `max_seconds`, each with a new id (0, 1, ...).

    The first cut of a track is after a fraction of `max_seconds` that depends on its id; fractions are evenly
    distributed, so that tracks do not all end together. Deterministic; times, pixels and row order are
    unchanged.

    Raises:
        RecordingError: `max_seconds` is not positive and finite.
    """
    if not (np.isfinite(max_seconds) and max_seconds > 0.0):
        raise RecordingError(
            f"the maximum track length is {max_seconds} s; expected a positive number of seconds"
        )
    length_ns = max(1, round(min(max_seconds, 1e9) * NS_PER_S))
    ids, index = np.unique(rows["id"], return_inverse=True)
    first_ns = np.full(ids.size, np.iinfo(np.int64).max)
    np.minimum.at(first_ns, index, rows["t_ns"])
    with np.errstate(over="ignore"):
        fraction = (ids.astype(np.uint64) * _GOLDEN) / np.float64(2.0**64)
    phase_ns = np.minimum((fraction * length_ns).astype(np.int64), length_ns - 1)
    piece = (rows["t_ns"] - first_ns[index] + phase_ns[index]) // length_ns
    _, new_id = np.unique(np.stack([index, piece], axis=1), axis=0, return_inverse=True)
    cut = rows.copy()
    cut["id"] = new_id.reshape(-1)
    return cut
