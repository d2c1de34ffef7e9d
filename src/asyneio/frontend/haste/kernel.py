"""The correlation* tracker of HASTE: one record a feature, nothing allocated while events flow.

Alzugaray & Chli, "HASTE: multi-Hypothesis Asynchronous Speeded-up Tracking of Events", BMVC 2020; constants
and order of operations after the authors' released program (github.com/ialzugaray/haste). A feature keeps its
last 193 events and eleven hypotheses of its pose: where it is, moved to one of the eight neighbouring pixels,
or turned by four degrees either way. The score of a hypothesis is the sum, over the window, of the template
at the events' places in the patch under that pose. An event that enters the window adds one look-up to every
score and the one that leaves takes one away; only a change of state scores the whole window anew.
"""

from __future__ import annotations

import numba as nb
import numpy as np

from asyneio.frontend.tracker import GROWING, TRACKING, Record
from asyneio.types import FloatArray

#: Half side of the patch and radius of the disc whose events are fed to the feature [px].
RADIUS = 15
SIDE = 2 * RADIUS + 1

#: Coordinates in the patch have a bilinear value from 0 to here, exclusive.
LAST = float(SIDE - 1)

#: Events in the window (a fifth of the patch, made odd), and the one in its middle, counted from the oldest.
WINDOW = 193
MIDDLE = 96

#: Steps between a pose and its neighbours: pixels in the image, and turn [rad].
TURN = np.deg2rad(4.0)
STEPS = np.zeros((11, 3))
STEPS[1:9, :2] = [(1, 0), (-1, 0), (0, 1), (0, -1), (1, 1), (-1, 1), (-1, -1), (1, -1)]
STEPS[9:, 2] = TURN, -TURN
HYPOTHESES = STEPS.shape[0]

#: By how much of the spread of all scores the best must exceed the present one, and what share of an event
#: the template learns.
HYSTERESIS = 0.05
LEARNING_RATE = 0.1


#: One feature; positions in distorted pixels. A record rather than an array for each field: Numba counts
#: references to arrays, and that takes longer than the arithmetic.
HASTE_DTYPE = np.dtype(
    [
        ("state", "<i8"),  # FREE, GROWING (the window fills for the first time) or TRACKING
        ("id", "<i8"),
        ("x", "<f8"),
        ("y", "<f8"),
        ("turn", "<f8"),  # rad, since birth
        ("t_ns", "<i8"),  # of the event in the middle of the window; of birth while growing
        ("reported_ns", "<i8"),  # time of the last observation
        ("written", "<i8"),  # events put into the window since birth
        ("window_t", "<i8", (WINDOW,)),  # ns, a ring
        ("window_xy", "<f8", (WINDOW, 2)),
        ("template", "<f8", (SIDE, SIDE)),  # events, row v, column u of the patch
        ("reference", "<f8", (SIDE, SIDE)),  # the template at the last change of state; scores refer to it
        ("hypotheses", "<f8", (HYPOTHESES, 4)),  # x, y, cosine and sine of the turn
        ("score", "<f8", (HYPOTHESES,)),
    ]
)


@nb.njit(cache=True)
def correlate(feature: Record, k: int, end: int, sign: float) -> None:
    """Add (`sign` 1) or take away (-1) what events k..end-1 of the window contribute to each score.

    The reference is read bilinearly, and as zero outside.
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


@nb.njit(cache=True)
def learn(feature: Record, k: int, weight: float) -> None:
    """Share event k of the window among the template's four pixels around where the present pose sees it."""
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


@nb.njit(cache=True)
def spread_hypotheses(feature: Record) -> None:
    """Put the hypotheses around the present pose."""
    for i in range(HYPOTHESES):
        turn = feature.turn + STEPS[i, 2]
        feature.hypotheses[i, 0] = feature.x + STEPS[i, 0]
        feature.hypotheses[i, 1] = feature.y + STEPS[i, 1]
        feature.hypotheses[i, 2] = np.cos(turn)
        feature.hypotheses[i, 3] = np.sin(turn)


@nb.njit(cache=True)
def score_window(feature: Record) -> None:
    """Take the template of now as reference and score all hypotheses over the whole window.

    The published scores are divided by the sums of template and weights; that changes none of the ratios on
    which a change of state depends, and is left out.
    """
    # Loops: Numba takes seconds to compile the assignment of one array to another.
    for row in range(SIDE):
        for column in range(SIDE):
            feature.reference[row, column] = feature.template[row, column]
    for i in range(HYPOTHESES):
        feature.score[i] = 0.0
    correlate(feature, 0, WINDOW, 1.0)


@nb.njit(cache=True)
def best_hypothesis(score: FloatArray) -> int:
    """The hypothesis to go to: 0 unless another beats it by more than the hysteresis."""
    best, highest, lowest = 0, score[0], score[0]
    for i in range(1, HYPOTHESES):
        if score[i] > highest:
            best, highest = i, score[i]
        lowest = min(lowest, score[i])
    return best if highest - score[0] > HYSTERESIS * (highest - lowest) else 0


@nb.njit(cache=True)
def feed(feature: Record, t_ns: int, x: int, y: int) -> bool:
    """Give a feature an event of its disc; whether its state has changed, or is known for the first time."""
    k = feature.written % WINDOW
    feature.written += 1
    if feature.state == TRACKING:
        correlate(feature, k, k + 1, -1.0)
    feature.window_t[k] = t_ns
    feature.window_xy[k, 0] = x
    feature.window_xy[k, 1] = y
    if feature.written < WINDOW:
        return False
    # Place k holds the newest event, so the oldest is the next one.
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
    # After the change of state, as published; the reference follows only at the next one.
    learn(feature, middle, LEARNING_RATE)
    return best != 0
