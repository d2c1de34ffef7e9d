"""The front end: packets of events in, feature observations out."""

from __future__ import annotations

import numpy as np

from asyneio.frontend.features import make_features
from asyneio.frontend.gradient_template import TemplateSettings, make_workspace
from asyneio.frontend.kernel import LoopSettings, process_events
from asyneio.frontend.registration import make_registration
from asyneio.frontend.surface import make_surface, refresh_hot_pixels
from asyneio.types import RecordArray

TRACK_DTYPE = np.dtype(
    [("t_ns", "<i8"), ("id", "<i8"), ("u", "<f8"), ("v", "<f8"), ("ncc", "<f8"), ("novelty", "<f8"),
     ("h", "<f8", (3,)), ("tw", "<f8"), ("tt", "<f8"), ("ww", "<f8")]
)

DEFAULT = TemplateSettings(
    step_px=1.0, window_px=2.0, kept_per_px=200.0, min_step_events=30, min_window_events=100,
    max_window_ns=250_000_000, memory_px=30.0, ridge_px2=0.1, min_ncc=0.65, max_jump_px=2.9, max_refusals=3,
    velocity_gain=0.5, mask_sigma_px=6.0, birth_px=1.5, birth_events=150, feed_radius_px=12.0,
)
LOOP = LoopSettings(
    silence_ns=50_000_000, spacing_px=10.0, border_px=6, t_min_ns=5_000_000, t_max_ns=300_000_000,
    birth_max_ns=200_000_000, max_features=100,
)


class Frontend:
    def __init__(self, width: int, height: int, template=DEFAULT, loop=LOOP) -> None:
        self.template, self.loop = template, loop
        self.surface = make_surface(width, height)
        self.features = make_features(loop.max_features)
        self.registration = make_registration(width, height, loop.max_features)
        self.work = make_workspace(template.mask_sigma_px)
        self.counters = np.zeros(16, dtype=np.int64)
        self.balance = np.array([0.0, 0.0, 1.0, 1.0])
        self.roll = 0.0
        self.buffer = np.zeros(65536, dtype=TRACK_DTYPE)
        self.hot_since = None

    def process(self, events: RecordArray, roll_rate: float = 0.0) -> RecordArray:
        if events.size == 0:
            return self.buffer[:0].copy()
        t0 = int(events["t_ns"][0])
        if self.hot_since is None:
            self.hot_since = t0
        out, start = [], 0
        while start < events.size:
            start, n = process_events(
                events, start, self.surface, self.features, self.registration, self.loop, self.template,
                self.work, self.balance, self.roll, roll_rate, t0, self.counters, self.buffer,
            )
            out.append(self.buffer[:n].copy())
        self.roll += roll_rate * (int(events["t_ns"][-1]) - t0) * 1e-9
        on, off = self.balance[1], self.balance[0]
        if on + off > 20000:
            r = np.sqrt(max(off, 1.0) / max(on, 1.0))
            self.balance[2], self.balance[3] = np.clip(r, 0.5, 2), np.clip(1 / r, 0.5, 2)
            self.balance[:2] *= 0.5
        elapsed = (int(events["t_ns"][-1]) - self.hot_since) * 1e-9
        if elapsed > 1.0:
            refresh_hot_pixels(self.surface, elapsed, 5.0, 25.0)
            self.hot_since = int(events["t_ns"][-1])
        return np.concatenate(out)
