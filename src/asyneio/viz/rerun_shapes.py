# SPDX-License-Identifier: Apache-2.0
"""Tracks, covariances and landmarks as lines and points."""

from __future__ import annotations

import numpy as np

from asyneio.types import FloatArray, RecordArray

#: Landmarks whose distance from the median position exceeds this multiple of the median are not drawn.
_FARTHEST = 10.0
#: A covariance is drawn as an ellipse of three sigma; an unknown one as a circle of this radius [px].
_SIGMAS, _UNKNOWN_PX = 3.0, 1.0


def newest_of_tracks(observations: RecordArray) -> RecordArray:
    """The newest observation of each track."""
    order = np.lexsort((observations["t_ns"], observations["id"]))
    rows = observations[order]
    last = np.r_[rows["id"][1:] != rows["id"][:-1], True] if rows.size else np.empty(0, dtype=bool)
    return rows[last]


def strips(observations: RecordArray) -> list[FloatArray]:
    """Positions of each track with more than one observation, (K,2) in order of time."""
    order = np.lexsort((observations["t_ns"], observations["id"]))
    rows = observations[order]
    points = np.column_stack([rows["u"], rows["v"]])
    cuts = np.flatnonzero(np.diff(rows["id"])) + 1
    return [strip for strip in np.split(points, cuts) if len(strip) > 1]


def ellipses(observations: RecordArray) -> list[FloatArray]:
    """Outlines (17,2) of three sigma [px]."""
    turn = np.linspace(0.0, 2.0 * np.pi, 17)
    circle = np.vstack([np.cos(turn), np.sin(turn)])
    outlines = []
    for row in observations:
        uu, uv, vv = (float(c) for c in row["covariance"])
        known = uu > 0.0 and vv > 0.0
        values, axes = np.linalg.eigh([[uu, uv], [uv, vv]])
        radii = _SIGMAS * np.sqrt(np.maximum(values, 0.0)) if known else np.full(2, _UNKNOWN_PX)
        outline = (axes * radii) @ circle
        outlines.append(outline.T + np.array([row["u"], row["v"]]))
    return outlines


def near(landmarks: FloatArray) -> FloatArray:
    """Landmarks without distant ones, which would shrink the others to a dot."""
    distance = np.linalg.norm(landmarks - np.median(landmarks, axis=0), axis=1)
    return landmarks[distance <= _FARTHEST * np.median(distance)]
