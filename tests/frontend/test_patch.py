"""Drawing, blurring and shifting of patches, and the flow of a young one, against numpy and scipy."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.ndimage import convolve1d, map_coordinates

from asyneio.frontend.gradient.features import (
    MATCH_HALF,
    PATCH_HALF,
    PATCH_SIDE,
    RING,
    TEMPLATE_SIDE,
    newest_events,
    thin_out,
)
from asyneio.frontend.gradient.flow import find_flow, peak_of
from asyneio.frontend.gradient.patch import blur, contrast, draw_patch, restrict, shift_patch, weigh
from tests.conftest import SEED
from tests.frontend.patches import (
    blobs,
    fill_ring,
    grid,
    make_feature,
    make_work,
    patch_of,
    unflatten,
)


def test_drawing_is_motion_compensation_and_bilinear_sharing() -> None:
    rng = np.random.default_rng(SEED)
    n, t_ns, vx, vy, roll, rate = 300, 10_000_000, 80.0, -50.0, 0.4, 1.5
    stamps = np.sort(rng.integers(0, 2 * t_ns, n))
    # Some fall outside the patch.
    x, y = rng.integers(84, 118, n), rng.integers(62, 98, n)
    w = rng.choice([-0.8, 1.25], n).astype(np.float32)
    feature = make_feature()
    ring = fill_ring(feature, stamps, x, y, w)
    work = make_work()
    for name, value in {"x": 100.3, "y": 80.6, "vx": vx, "vy": vy, "roll": roll, "roll_rate": rate}.items():
        work[name] = value
    work["t_ns"] = t_ns
    draw_patch(ring, 0, n - 1, n, work[0])

    expected = np.zeros((PATCH_SIDE + 2, PATCH_SIDE + 2))
    dt = (stamps - t_ns) * 1e-9
    d = np.stack([x - 100.3 - vx * dt, y - 80.6 - vy * dt])
    angle = roll + rate * dt
    u = np.cos(angle) * d[0] + np.sin(angle) * d[1] + PATCH_HALF
    v = np.cos(angle) * d[1] - np.sin(angle) * d[0] + PATCH_HALF
    inside = (u >= 0) & (v >= 0) & (u < PATCH_SIDE - 1) & (v < PATCH_SIDE - 1)
    assert 0 < np.count_nonzero(~inside) < n / 2
    for a, b, c in zip(u[inside], v[inside], w[inside], strict=True):
        i, j = int(a), int(b)
        expected[j : j + 2, i : i + 2] += c * np.outer([1 - b + j, b - j], [1 - a + i, a - i])
    np.testing.assert_allclose(unflatten(work["patch"][0]), expected[:PATCH_SIDE, :PATCH_SIDE], atol=2e-3)


def test_blur_is_that_of_scipy() -> None:
    rng = np.random.default_rng(SEED)
    work = make_work()
    work["patch"] = patch_of(lambda x, y: rng.normal(0, 1, x.shape))
    blur(work[0])
    kernel = np.array([1, 4, 6, 4, 1]) / 16
    image = unflatten(work["patch"][0])
    expected = convolve1d(convolve1d(image, kernel, axis=0, mode="constant"), kernel, axis=1, mode="constant")
    blurred = unflatten(work["blurred"][0])
    np.testing.assert_allclose(blurred[2:-2, 2:-2], expected[2:-2, 2:-2], atol=1e-5)
    blurred[2:-2, 2:-2] = 0
    assert not blurred.any()
    inner = unflatten(work["blurred"][0])[3:-3, 3:-3]
    assert contrast(work[0]) == pytest.approx(np.sum(unflatten(work["mask"][0]) * inner**2), rel=1e-5)


@pytest.mark.parametrize("shift", [(0.0, 0.0), (0.3, -0.8), (-2.9, 2.9), (2.9, -2.9), (1.0, -2.0)])
def test_shift_is_bilinear(shift: tuple[float, float]) -> None:
    work = make_work()
    work["blurred"] = patch_of(blobs(SEED))
    shift_patch(work[0], *shift)
    x, y = grid(TEMPLATE_SIDE)
    where = [y + PATCH_HALF + shift[1], x + PATCH_HALF + shift[0]]
    expected = map_coordinates(unflatten(work["blurred"][0]), where, order=1)
    np.testing.assert_allclose(unflatten(work["shifted"][0]), expected, atol=1e-5)


def test_weights_leave_out_what_lay_outside_the_image() -> None:
    x, y = grid(TEMPLATE_SIDE)
    feature, work = make_feature(), make_work()
    mask = np.exp(-(x**2 + y**2) / 72) * (np.maximum(abs(x), abs(y)) <= MATCH_HALF)
    np.testing.assert_allclose(unflatten(work["weight"][0]), mask, atol=1e-6)
    # The patch reaches over the left and the lower border, and later over the right one.
    restrict(feature[0], 5.2, 176.0, 240, 180)
    inside = (x + 5.2 >= 1) & (y + 176.0 <= 178)
    share = weigh(feature[0], work[0])
    assert share == pytest.approx(np.sum(mask * inside) / np.sum(mask), rel=1e-5)
    restrict(feature[0], 235.7, 90.0, 240, 180)
    inside &= x + 235.7 <= 238
    share = weigh(feature[0], work[0])
    assert share == pytest.approx(np.sum(mask * inside) / np.sum(mask), rel=1e-5)
    np.testing.assert_allclose(unflatten(work["weight"][0]), mask * inside, atol=1e-6)


def test_newest_events_are_limited_by_number_and_by_age() -> None:
    feature = make_feature()
    stamps = np.arange(RING + 100) * 1000
    ring = fill_ring(feature, stamps, stamps * 0, stamps * 0, stamps * 0)
    for wanted, max_ns, count in ((50, 10**9, 50), (10_000, 10**9, RING), (400, 99_500, 100), (9, 0, 1)):
        n, first, mean, last = newest_events(feature[0], ring, 0, wanted, max_ns)
        taken = stamps[-count:]
        assert (n, first, last) == (count, taken[0], taken[-1])
        assert mean == pytest.approx(np.mean(taken), abs=1)


def test_thinning_keeps_every_other_event_at_twice_the_weight() -> None:
    feature = make_feature()
    i = np.arange(RING)
    ring = fill_ring(feature, i, i % 7, i % 5, np.where(i % 2, 1.0, -1.0))
    thin_out(feature[0], ring, 0)
    assert feature["written"][0] == RING // 2
    assert feature["stride"][0] == 2
    kept = ring[0, : RING // 2]
    np.testing.assert_array_equal(kept["t_ns"], i[1::2])
    np.testing.assert_array_equal(kept["x"], (i % 7)[1::2])
    np.testing.assert_array_equal(kept["w"], 2.0)


@pytest.mark.parametrize("velocity", [(90.0, -40.0), (-25.0, 110.0), (60.0, 60.0)])
def test_flow_is_found_from_rest(velocity: tuple[float, float]) -> None:
    """Events of fifteen points that move for 40 ms."""
    rng = np.random.default_rng(SEED)
    n, span_s = 400, 0.04
    points = rng.uniform(-9, 9, (15, 2))
    which = rng.integers(15, size=n)
    seconds = np.sort(rng.uniform(0, span_s, n))
    place = points[which] + np.outer(seconds - span_s / 2, velocity) + [100, 80]
    x, y = np.rint(place + rng.uniform(-0.5, 0.5, place.shape)).astype(int).T
    feature, work = make_feature(), make_work()
    ring = fill_ring(feature, (seconds * 1e9).astype(int), x, y, np.where(which % 2, 1.0, -1.0))
    work["t_ns"], work["x"], work["y"] = span_s / 2 * 1e9, 100, 80
    sharpening = find_flow(ring, 0, n - 1, n, span_s, 5, work[0])
    assert sharpening > 1.05
    # Within a pixel over the window: registration does the rest.
    assert abs(work["vx"][0] - velocity[0]) * span_s < 0.8
    assert abs(work["vy"][0] - velocity[1]) * span_s < 0.8


def test_the_peak_of_a_paraboloid_is_found() -> None:
    rng = np.random.default_rng(SEED)
    v, u = np.mgrid[-1.0:2.0, -1.0:2.0]
    for _ in range(100):
        du, dv = rng.uniform(-1.4, 1.4, 2)
        a, c = rng.uniform(0.5, 2.0, 2)
        b = rng.uniform(-0.9, 0.9) * np.sqrt(a * c)
        values = 7.0 - a * (u - du) ** 2 - 2.0 * b * (u - du) * (v - dv) - c * (v - dv) ** 2
        assert peak_of(values) == pytest.approx((du, dv), abs=1e-9)


def test_without_a_peak_the_largest_value_counts() -> None:
    v, u = np.mgrid[-1.0:2.0, -1.0:2.0]
    assert peak_of(u * v + 0.1 * u) == (1.0, 1.0)
    assert peak_of(5.0 * u - 0.01 * u**2 - 0.01 * v**2 + 0.5 * v) == (1.0, 1.0)
    assert peak_of(np.zeros((3, 3))) == (-1.0, -1.0)
