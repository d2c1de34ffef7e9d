"""Hand-made features and patches for the tests."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from asyneio.frontend.gradient.features import (
    FEATURE_DTYPE,
    PATCH_HALF,
    PATCH_SIDE,
    PATCH_SIZE,
    RING,
    RING_DTYPE,
    ROW,
    TEMPLATE_HALF,
    TEMPLATE_SIDE,
    TEMPLATE_SIZE,
    begin,
)
from asyneio.frontend.gradient.patch import make_workspace, weigh
from asyneio.types import EVENT_DTYPE, FloatArray, RecordArray
from tests.conftest import SEED

Picture = Callable[[FloatArray, FloatArray], FloatArray]


def with_noise(events: RecordArray, share: float, size: tuple[int, int]) -> RecordArray:
    """Events (EVENT_DTYPE) with `share` times as many of random pixels, times and polarities."""
    rng = np.random.default_rng(SEED)
    noise = np.zeros(round(share * events.size), dtype=EVENT_DTYPE)
    noise["t_ns"] = rng.integers(int(events["t_ns"][0]), int(events["t_ns"][-1]), noise.size)
    noise["x"], noise["y"] = rng.integers(0, size[0], noise.size), rng.integers(0, size[1], noise.size)
    noise["p"] = rng.integers(0, 2, noise.size)
    both = np.concatenate([events, noise])
    return both[np.argsort(both["t_ns"], kind="stable")]


def make_feature(x: float = 100.0, y: float = 80.0) -> RecordArray:
    """One young feature (1,) FEATURE_DTYPE."""
    feature = np.zeros(1, dtype=FEATURE_DTYPE)
    begin(feature[0], 0, x, y, 150)
    feature["x"], feature["y"] = x, y
    return feature


def fill_ring(
    feature: RecordArray, t_ns: FloatArray, x: FloatArray, y: FloatArray, w: FloatArray
) -> RecordArray:
    """A ring (1,RING) that has received these events, as many as there are."""
    ring = np.zeros((1, RING), dtype=RING_DTYPE)
    for i in range(len(t_ns)):
        ring[0, i % RING] = t_ns[i], x[i], y[i], w[i]
    feature["written"] = len(t_ns)
    return ring


def make_work(feature: RecordArray | None = None) -> RecordArray:
    """A workspace (1,) whose weights are those of a feature, by default of one well inside the image."""
    work = make_workspace(6.0)
    weigh((make_feature() if feature is None else feature)[0], work[0])
    return work


def unflatten(flat: FloatArray) -> FloatArray:
    """A patch or template (side, side) from its flat form."""
    side = PATCH_SIDE if flat.size == PATCH_SIZE else TEMPLATE_SIDE
    rows = np.zeros(side * ROW)
    rows[: flat.size] = flat
    return rows.reshape(side, ROW)[:, :side].astype(np.float64)


def flatten(image: FloatArray) -> FloatArray:
    """The flat form of a patch or a template."""
    size = PATCH_SIZE if len(image) == PATCH_SIDE else TEMPLATE_SIZE
    rows = np.zeros((len(image), ROW), dtype=np.float32)
    rows[:, : len(image)] = image
    return rows.ravel()[:size]


def grid(side: int) -> tuple[FloatArray, FloatArray]:
    """Coordinates x, y (side, side) from the centre."""
    axis = np.arange(side) - side // 2.0
    return np.tile(axis, (side, 1)), np.tile(axis[:, None], (1, side))


def patch_of(picture: Picture, du: float = 0.0, dv: float = 0.0) -> FloatArray:
    """A picture shifted by d, flat, over a patch; without the rim that a blurred patch leaves empty."""
    x, y = grid(2 * PATCH_HALF + 1)
    image = picture(x - du, y - dv)
    image[:2] = image[-2:] = image[:, :2] = image[:, -2:] = 0.0
    return flatten(image)


def template_of(picture: Picture) -> FloatArray:
    """A picture, flat, over a template."""
    return flatten(picture(*grid(2 * TEMPLATE_HALF + 1)))


def blobs(seed: int, count: int = 25) -> Picture:
    """A smooth random picture: signed Gaussian blobs of sigma 2 to 3 px."""
    rng = np.random.default_rng(seed)
    places, sigmas = rng.uniform(-13, 13, (count, 2)), rng.uniform(2, 3, count)
    heights = rng.choice([-1.0, 1.0], count) * rng.uniform(1, 3, count)

    def picture(x: FloatArray, y: FloatArray) -> FloatArray:
        return sum(
            h * np.exp(-((x - u) ** 2 + (y - v) ** 2) / (2 * s * s))
            for (u, v), s, h in zip(places, sigmas, heights, strict=True)
        )

    return picture
