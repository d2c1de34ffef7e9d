"""FA-Harris corners on the surface of active events (Li et al., IROS 2019).

An arc test on two circles keeps the few events that can be corners; the Harris score of the latest events in
a 9x9 patch decides.
"""

from __future__ import annotations

import numba as nb
import numpy as np

from asyneio.types import FloatArray, IntArray

#: Circles of radius 3 and 4 in order around the centre (dx, dy), as in eFAST.
INNER = np.stack(
    [
        [0, 1, 2, 3, 3, 3, 2, 1, 0, -1, -2, -3, -3, -3, -2, -1],
        [3, 3, 2, 1, 0, -1, -2, -3, -3, -3, -2, -1, 0, 1, 2, 3],
    ],
    axis=1,
)
OUTER = np.stack(
    [
        [0, 1, 2, 3, 4, 4, 4, 3, 2, 1, 0, -1, -2, -3, -4, -4, -4, -3, -2, -1],
        [4, 4, 3, 2, 1, 0, -1, -2, -3, -4, -4, -4, -3, -2, -1, 0, 1, 2, 3, 4],
    ],
    axis=1,
)

#: Half the side of the patch of the Harris score, and how many of its latest pixels are set.
HARRIS_RADIUS = 4
HARRIS_EVENTS = 25
HARRIS_K = 0.04
HARRIS_THRESHOLD = 8.0

#: Length of the working memory of a test.
SCRATCH = 2 * (2 * HARRIS_RADIUS + 1) ** 2

#: Margin [px] that both tests need around an event.
MARGIN = 4


def gaussian_5x5() -> FloatArray:
    """Weights (5,5) of the structure tensor, sigma 1, sum one."""
    axis = np.arange(-2.0, 3.0)
    weight = np.exp(-0.5 * axis**2)
    kernel = np.outer(weight, weight)
    return np.asarray(kernel / kernel.sum())


_GAUSSIAN = gaussian_5x5()


@nb.njit(cache=True)
def is_corner(latest_ns: IntArray, p: int, x: int, y: int, scratch: IntArray) -> bool:
    """FA-Harris test at the newest event (x, y) of polarity p on the surface `latest_ns` (H,W,2).

    `scratch` (SCRATCH,) int64 saves an allocation a call.
    """
    height, width = latest_ns.shape[:2]
    if x < MARGIN or y < MARGIN or x >= width - MARGIN or y >= height - MARGIN:
        return False
    if not _has_arc(latest_ns, p, x, y, INNER, 3, 6, scratch):
        return False
    if not _has_arc(latest_ns, p, x, y, OUTER, 4, 8, scratch):
        return False
    return harris_score(latest_ns, p, x, y, scratch) > HARRIS_THRESHOLD


@nb.njit(cache=True)
def _has_arc(
    latest_ns: IntArray,
    p: int,
    x: int,
    y: int,
    circle: IntArray,
    shortest: int,
    longest: int,
    scratch: IntArray,
) -> bool:
    """Whether the newest pixels of a circle form one arc of `shortest`..`longest`, or its complement does.

    An arc grows from the newest pixel towards the newer of its two neighbours until it has swallowed the
    circle; the arc of a length holds the newest pixels when none swallowed later is newer than one swallowed
    before.
    """
    n = circle.shape[0]
    newest = 0
    newest_ns = latest_ns[y + circle[0, 1], x + circle[0, 0], p]
    for i in range(n):
        t_ns = latest_ns[y + circle[i, 1], x + circle[i, 0], p]
        scratch[i] = t_ns
        if t_ns > newest_ns:
            newest = i
            newest_ns = t_ns
    right = newest + 1 if newest + 1 < n else 0
    left = newest - 1 if newest > 0 else n - 1
    scratch[n] = newest_ns
    for length in range(1, n):
        if scratch[right] > scratch[left]:
            scratch[n + length] = scratch[right]
            right = right + 1 if right + 1 < n else 0
        else:
            scratch[n + length] = scratch[left]
            left = left - 1 if left > 0 else n - 1
    # Newest of those swallowed after each length.
    later_ns = scratch[2 * n - 1]
    for length in range(n - 1, 0, -1):
        scratch[length] = later_ns
        later_ns = max(later_ns, scratch[n + length - 1])
    oldest_ns = newest_ns
    for length in range(1, n - shortest + 1):
        oldest_ns = min(oldest_ns, scratch[n + length - 1])
        if oldest_ns < scratch[length]:
            continue
        if shortest <= length <= longest or length >= n - longest:
            return True
    return False


@nb.njit(cache=True)
def harris_score(latest_ns: IntArray, p: int, x: int, y: int, scratch: IntArray) -> float:
    """Harris score of the binary 9x9 patch in which the latest 25 pixels are set.

    The 5x5 derivative is smoothing (1 4 6 4 1) times slope (-1 -2 0 2 1), its largest entry scaled to one as
    in eHarris (Vasco et al. 2016), computed one axis after the other.
    """
    side = 2 * HARRIS_RADIUS + 1
    stamps, order = scratch[: side * side], scratch[side * side :]
    for v in range(side):
        for u in range(side):
            t_ns = latest_ns[y + v - HARRIS_RADIUS, x + u - HARRIS_RADIUS, p]
            stamps[v * side + u] = t_ns
            order[v * side + u] = t_ns
    threshold = _nth_largest(order, HARRIS_EVENTS)
    smooth = np.empty(side * 5, dtype=np.float64)
    slope = np.empty(side * 5, dtype=np.float64)
    for v in range(side):
        for u in range(5):
            k = v * side + u
            a, b, c = stamps[k] >= threshold, stamps[k + 1] >= threshold, stamps[k + 2] >= threshold
            d, e = stamps[k + 3] >= threshold, stamps[k + 4] >= threshold
            smooth[v * 5 + u] = (a + e) + 4.0 * (b + d) + 6.0 * c
            slope[v * 5 + u] = (e - 1.0 * a) + 2.0 * (d - 1.0 * b)
    xx = yy = xy = 0.0
    for v in range(5):
        for u in range(5):
            k = v * 5 + u
            dx = slope[k] + slope[k + 20] + 4.0 * (slope[k + 5] + slope[k + 15]) + 6.0 * slope[k + 10]
            dy = smooth[k + 20] - smooth[k] + 2.0 * (smooth[k + 15] - smooth[k + 5])
            weight = _GAUSSIAN[v, u] / 144.0
            xx += weight * dx * dx
            yy += weight * dy * dy
            xy += weight * dx * dy
    trace = xx + yy
    return xx * yy - xy * xy - HARRIS_K * trace * trace


@nb.njit(cache=True)
def _nth_largest(values: IntArray, n: int) -> int:
    """The n-th largest value; reorders its input (quickselect)."""
    left, right, wanted = 0, values.size - 1, n - 1
    while left < right:
        pivot = values[(left + right) // 2]
        i, j = left, right
        while i <= j:
            while values[i] > pivot:
                i += 1
            while values[j] < pivot:
                j -= 1
            if i <= j:
                values[i], values[j] = values[j], values[i]
                i += 1
                j -= 1
        if wanted <= j:
            right = j
        elif wanted >= i:
            left = i
        else:
            break
    return values[wanted]
