# SPDX-License-Identifier: Apache-2.0
"""The correlation* tracker of HASTE: one record per feature, with no allocation while events are processed.

Alzugaray & Chli, "HASTE: multi-Hypothesis Asynchronous Speeded-up Tracking of Events", BMVC 2020; constants
and order of operations follow the program released by the authors (github.com/ialzugaray/haste). A feature
keeps its last 193 events and eleven hypotheses of its pose: unchanged, moved to one of the eight neighbouring
pixels, or rotated by four degrees in either direction. The score of a hypothesis is the sum, over the window,
of the template at the positions of the events in the patch under that pose. An event that enters the window
adds one value to every score, and the event that leaves it subtracts one. Only a change of state recomputes
the scores over the whole window.
"""

from __future__ import annotations

import numpy as np

from asyneio.frontend.tracker import GROWING, TRACKING, Record
from asyneio.jit import njit
from asyneio.types import FloatArray

#: Half side of the patch and radius of the disc whose events are fed to the feature [px].
RADIUS = 15
SIDE = 2 * RADIUS + 1

#: Coordinates in the patch can be interpolated from 0 to LAST, exclusive.
LAST = float(SIDE - 1)

#: Events in the window (a fifth of the pixels, made odd), and the index of its middle, from the oldest.
WINDOW = 193
MIDDLE = 96

#: Steps from a pose to its hypotheses: x and y [px], rotation [rad].
TURN = np.deg2rad(4.0)
STEPS = np.zeros((11, 3))
STEPS[1:9, :2] = [(1, 0), (-1, 0), (0, 1), (0, -1), (1, 1), (-1, 1), (-1, -1), (1, -1)]
STEPS[9:, 2] = TURN, -TURN
HYPOTHESES = STEPS.shape[0]

#: Share of the range of all scores by which the best must exceed the current one, and the weight with which
#: an event is added to the template.
HYSTERESIS = 0.05
LEARNING_RATE = 0.1


#: One feature; positions in distorted pixels. A record, not one array per field: Numba counts references to
#: arrays, which takes longer than the arithmetic.
HASTE_DTYPE = np.dtype(
    [
        ("state", "<i8"),  # FREE, GROWING (the window fills for the first time) or TRACKING
        ("id", "<i8"),
        ("x", "<f8"),
        ("y", "<f8"),
        ("turn", "<f8"),  # rad, since birth
        ("t_ns", "<i8"),  # of the event in the middle of the window; while growing, of the corner
        ("reported_ns", "<i8"),  # time of the last observation
        ("written", "<i8"),  # events put into the window since birth
        ("window_t", "<i8", (WINDOW,)),  # ns, a ring
        ("window_xy", "<f8", (WINDOW, 2)),
        ("template", "<f8", (SIDE, SIDE)),  # events, row v, column u of the patch
        ("reference", "<f8", (SIDE, SIDE)),  # the template at the last change of state, used for the scores
        ("hypotheses", "<f8", (HYPOTHESES, 4)),  # x, y, cosine and sine of the turn
        ("score", "<f8", (HYPOTHESES,)),
    ]
)


@njit(cache=True)
def correlate(feature: Record, k: int, end: int, sign: float) -> None:
    """Add (`sign` 1) or subtract (-1) the contribution of events k..end-1 of the window to each score.

    The reference is interpolated bilinearly; it is zero outside.
    """
    reference, window, score = feature.reference, feature.window_xy, feature.score
    for i in range(HYPOTHESES):
        x, y = feature.hypotheses[i, 0], feature.hypotheses[i, 1]
        c, s = feature.hypotheses[i, 2], feature.hypotheses[i, 3]
        total = 0.0
        for j in range(k, end):
            dx, dy = window[j, 0] - x, window[j, 1] - y
            u, v = c * dx + s * dy + RADIUS, c * dy - s * dx + RADIUS
            if u >= 0.0 and v >= 0.0 and u < LAST and v < LAST:
                column, row = int(u), int(v)
                a, b = u - column, v - row
                upper, lower = reference[row, column], reference[row + 1, column]
                upper += a * (reference[row, column + 1] - upper)
                lower += a * (reference[row + 1, column + 1] - lower)
                total += upper + b * (lower - upper)
        score[i] += sign * total


@njit(cache=True)
def learn(feature: Record, k: int, weight: float) -> None:
    """Distribute event k of the window over the four nearest template pixels under the current pose."""
    dx, dy = feature.window_xy[k, 0] - feature.x, feature.window_xy[k, 1] - feature.y
    c, s = feature.hypotheses[0, 2], feature.hypotheses[0, 3]
    u, v = c * dx + s * dy + RADIUS, c * dy - s * dx + RADIUS
    if u >= 0.0 and v >= 0.0 and u < LAST and v < LAST:
        column, row = int(u), int(v)
        a, b = u - column, v - row
        template = feature.template
        template[row, column] += weight * (1.0 - a) * (1.0 - b)
        template[row, column + 1] += weight * a * (1.0 - b)
        template[row + 1, column] += weight * (1.0 - a) * b
        template[row + 1, column + 1] += weight * a * b


@njit(cache=True)
def spread_hypotheses(feature: Record) -> None:
    """Compute the hypotheses around the current pose."""
    for i in range(HYPOTHESES):
        turn = feature.turn + STEPS[i, 2]
        feature.hypotheses[i, 0] = feature.x + STEPS[i, 0]
        feature.hypotheses[i, 1] = feature.y + STEPS[i, 1]
        feature.hypotheses[i, 2] = np.cos(turn)
        feature.hypotheses[i, 3] = np.sin(turn)


@njit(cache=True)
def score_window(feature: Record) -> None:
    """Use the current template as reference and score all hypotheses over the whole window.

    The published scores are divided by the sums of template and weights. This is omitted, since it does not
    affect the ratios on which a change of state depends.
    """
    # Loops, since Numba takes seconds to compile the assignment of one array to another.
    for row in range(SIDE):
        for column in range(SIDE):
            feature.reference[row, column] = feature.template[row, column]
    for i in range(HYPOTHESES):
        feature.score[i] = 0.0
    correlate(feature, 0, WINDOW, 1.0)


@njit(cache=True)
def best_hypothesis(score: FloatArray) -> int:
    """The next hypothesis: 0, the current one, unless another exceeds it by more than the hysteresis."""
    best, highest, lowest = 0, score[0], score[0]
    for i in range(1, HYPOTHESES):
        if score[i] > highest:
            best, highest = i, score[i]
        lowest = min(lowest, score[i])
    return best if highest - score[0] > HYSTERESIS * (highest - lowest) else 0


@njit(cache=True)
def feed(feature: Record, t_ns: int, x: int, y: int) -> bool:
    """Add an event to the window of a feature; True if its pose has changed or is now known."""
    k = feature.written % WINDOW
    feature.written += 1
    if feature.state == TRACKING:
        correlate(feature, k, k + 1, -1.0)
    feature.window_t[k] = t_ns
    feature.window_xy[k, 0] = x
    feature.window_xy[k, 1] = y
    if feature.written < WINDOW:
        return False
    # Index k holds the newest event, so the oldest one follows it.
    middle = (k + 1 + MIDDLE) % WINDOW
    feature.t_ns = feature.window_t[middle]
    if feature.state == GROWING:
        feature.state = TRACKING
        feature.template.fill(0.0)
        spread_hypotheses(feature)
        for i in range(WINDOW):
            learn(feature, i, 1.0)
        score_window(feature)
        return True
    correlate(feature, k, k + 1, 1.0)
    best = best_hypothesis(feature.score)
    if best:
        feature.x += STEPS[best, 0]
        feature.y += STEPS[best, 1]
        feature.turn += STEPS[best, 2]
        spread_hypotheses(feature)
        score_window(feature)
    # After the change of state, as published; the reference is updated at the next change only.
    learn(feature, middle, LEARNING_RATE)
    return best != 0
