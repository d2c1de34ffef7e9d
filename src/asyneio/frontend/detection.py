# SPDX-License-Identifier: Apache-2.0
"""FA-Harris corners on the surface of active events (Li et al., IROS 2019).

An arc test on two circles selects the few events that may be corners. The Harris score of the latest events
in a 9x9 patch then decides.
"""

from __future__ import annotations

import numpy as np

from asyneio.frontend.surface import NEVER_NS
from asyneio.jit import njit
from asyneio.types import FloatArray, IntArray

#: Circles of radius 3 and 4 in order around the centre (dx, dy), as in eFAST.
INNER_CIRCLE = np.stack(
    [
        [0, 1, 2, 3, 3, 3, 2, 1, 0, -1, -2, -3, -3, -3, -2, -1],
        [3, 3, 2, 1, 0, -1, -2, -3, -3, -3, -2, -1, 0, 1, 2, 3],
    ],
    axis=1,
)
OUTER_CIRCLE = np.stack(
    [
        [0, 1, 2, 3, 4, 4, 4, 3, 2, 1, 0, -1, -2, -3, -4, -4, -4, -3, -2, -1],
        [4, 4, 3, 2, 1, 0, -1, -2, -3, -4, -4, -4, -3, -2, -1, 0, 1, 2, 3, 4],
    ],
    axis=1,
)

#: Half side of the patch of the Harris score, and the number of latest pixels that are set in it.
HARRIS_RADIUS = 4
HARRIS_EVENTS = 25
HARRIS_K = 0.04
HARRIS_THRESHOLD = 8.0

#: Size of the working memory of a test.
SCRATCH = (2 * HARRIS_RADIUS + 1) ** 2
#: First age [ns] in the search for the latest pixels.
_FIRST_WIDTH_NS = 4_000_000

#: Shortest arcs on the two circles; typed, so that the test is compiled once for both.
_SHORT, _LONG = np.int64(3), np.int64(4)

#: Margin [px] that both tests need around an event.
MARGIN = 4


def gaussian_5x5() -> FloatArray:
    """Weights (5,5) of the structure tensor, sigma 1, sum one."""
    axis = np.arange(-2.0, 3.0)
    weight = np.exp(-0.5 * axis**2)
    kernel = np.outer(weight, weight)
    return np.asarray(kernel / kernel.sum())


_GAUSSIAN = gaussian_5x5()


@njit(cache=True)
def is_corner(latest_ns: IntArray, p: int, x: int, y: int, scratch: IntArray) -> bool:
    """FA-Harris test of the newest event, at (x, y) with polarity p, on the surface `latest_ns` (H,W,2).

    `scratch` (SCRATCH,) int64 is working memory.
    """
    height, width = latest_ns.shape[:2]
    if x < MARGIN or y < MARGIN or x >= width - MARGIN or y >= height - MARGIN:
        return False
    # Flat, with unsigned indices, so that they need no check.
    flat = latest_ns.reshape(-1)
    middle = (y * width + x) * 2 + p
    if not _has_arc(flat, width, middle, INNER_CIRCLE, _SHORT, _SHORT * 2, scratch):
        return False
    if not _has_arc(flat, width, middle, OUTER_CIRCLE, _LONG, _LONG * 2, scratch):
        return False
    return harris_score(latest_ns, p, x, y, scratch) > HARRIS_THRESHOLD


@njit(cache=True)
def _has_arc(
    flat: IntArray, width: int, middle: int, circle: IntArray, shortest: int, longest: int, scratch: IntArray
) -> bool:
    """Whether the newest pixels of a circle form one arc of `shortest`..`longest`, or the oldest ones do.

    `flat` is the surface (H W 2,), `middle` the index of the circle's centre in it.
    The oldest pixels are tested as the newest ones with the sign of time inverted.
    """
    n = circle.shape[0]
    newest = oldest = int(np.int64(0))
    newest_ns = oldest_ns = flat[np.uint64(middle + 2 * (circle[0, 1] * width + circle[0, 0]))]
    for i in range(n):
        t_ns = flat[np.uint64(middle + 2 * (circle[i, 1] * width + circle[i, 0]))]
        scratch[i] = t_ns
        if t_ns > newest_ns:
            newest, newest_ns = i, t_ns
        if t_ns < oldest_ns:
            oldest, oldest_ns = i, t_ns
    if _is_one_arc(scratch, n, newest, shortest, longest):
        return True
    for i in range(n):
        scratch[i] = -scratch[i]
    return _is_one_arc(scratch, n, oldest, shortest, longest)


@njit(cache=True)
def _is_one_arc(scratch: IntArray, n: int, largest: int, shortest: int, longest: int) -> bool:
    """Whether the k largest of n values around a circle are adjacent, for any k in `shortest`..`longest`.

    An arc grows from the index `largest` towards the larger of its two neighbours. It contains the largest
    values if none outside is larger. Equal times are accepted, except those of pixels that never fired.
    """
    right = largest + 1 if largest + 1 < n else 0
    left = largest - 1 if largest > 0 else n - 1
    scratch[n] = smallest = scratch[largest]
    # The values in the order in which the arc takes them, then the smallest value for each length.
    for length in range(1, longest):
        if scratch[right] > scratch[left]:
            value = scratch[right]
            right = right + 1 if right + 1 < n else 0
        else:
            value = scratch[left]
            left = left - 1 if left > 0 else n - 1
        smallest = min(smallest, value)
        scratch[n + length] = value
        scratch[n + longest + length] = smallest
    outside = scratch[left]
    for _ in range(n - longest - 1):
        outside = max(outside, scratch[right])
        right = right + 1 if right + 1 < n else 0
    for length in range(longest, shortest - 1, -1):
        inside = scratch[n + longest + length - 1]
        if inside > outside or (inside == outside and abs(inside) != -NEVER_NS):
            return True
        outside = max(outside, scratch[n + length - 1])
    return False


@njit(cache=True)
def harris_score(latest_ns: IntArray, p: int, x: int, y: int, scratch: IntArray) -> float:
    """Harris score of the binary 9x9 patch in which the latest 25 pixels are set.

    The 5x5 derivative is smoothing (1 4 6 4 1) times slope (-1 -2 0 2 1), computed one axis after the other
    and scaled so that its largest entry is one, as in eHarris (Vasco et al. 2016).
    """
    side = 2 * HARRIS_RADIUS + 1
    count = side * side
    flat, width = latest_ns.reshape(-1), latest_ns.shape[1]
    for v in range(side):
        first = np.uint64(((y + v - HARRIS_RADIUS) * width + x - HARRIS_RADIUS) * 2 + p)
        for u in range(side):
            scratch[v * side + u] = flat[first + np.uint64(2 * u)]
    threshold = _nth_largest(scratch, count, HARRIS_EVENTS)
    latest = np.empty(count, dtype=np.float32)
    for k in range(count):
        latest[k] = np.float32(scratch[k] >= threshold)
    smooth = np.empty(count, dtype=np.float32)
    slope = np.empty(count, dtype=np.float32)
    two, four, six = np.float32(2.0), np.float32(4.0), np.float32(6.0)
    # Along the rows; results that span two rows are not used below.
    for k in range(count - 4):
        a, b, c, d, e = latest[k], latest[k + 1], latest[k + 2], latest[k + 3], latest[k + 4]
        smooth[k] = (a + e) + four * (b + d) + six * c
        slope[k] = (e - a) + two * (d - b)
    xx = yy = xy = 0.0
    for v in range(5):
        for u in range(5):
            k = v * side + u
            a, b, c, d, e = k, k + side, k + 2 * side, k + 3 * side, k + 4 * side
            dx = slope[a] + slope[e] + four * (slope[b] + slope[d]) + six * slope[c]
            dy = smooth[e] - smooth[a] + two * (smooth[d] - smooth[b])
            weight = _GAUSSIAN[v, u] / 144.0
            xx += weight * dx * dx
            yy += weight * dy * dy
            xy += weight * dx * dy
    trace = xx + yy
    return xx * yy - xy * xy - HARRIS_K * trace * trace


@njit(cache=True)
def _nth_largest(values: IntArray, count: int, n: int) -> int:
    """A threshold at or below the n-th largest of the first `count` values, and above all smaller values.

    Counting the values above a threshold uses full vectors, while sorting depends on every comparison. The
    next threshold assumes that the values between the bounds are evenly distributed.
    """
    newest = values[0]
    for k in range(1, count):
        newest = max(newest, values[k])
    width = _FIRST_WIDTH_NS
    above, too_few = int(newest) + 1, 0
    below = int(newest) - width
    enough = _reaching(values, count, below)
    while enough < n:
        above, too_few = below, enough
        width *= 4
        below = int(newest) - width
        enough = _reaching(values, count, below)
    while above - below > 1 and enough > n:
        share = (enough - n + 0.5) / (enough - too_few)
        # Not too close to either end, so that each step shortens the interval.
        share = min(max(share, 0.1), 0.9)
        middle = min(below + 1 + int(share * (above - below - 1)), above - 1)
        reaching = _reaching(values, count, middle)
        if reaching >= n:
            below, enough = middle, reaching
        else:
            above, too_few = middle, reaching
    return below


@njit(cache=True)
def _reaching(values: IntArray, count: int, threshold: int) -> int:
    """Number of the first `count` values that are at least `threshold`."""
    total = 0
    for k in range(count):
        total += int(values[k] >= threshold)
    return total
