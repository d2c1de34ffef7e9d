"""Algorithm 1 of the paper in plain Python: which features an event is fed to, begins, ends and reports.

Written from the paper and from docs/architecture.md ("What happens to one event"), with lists and
dictionaries in place of grids, buckets and records of counters. Three parts have oracles of their own and are
called: the corner test, the first template of a feature, and the match of a track against its template.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from asyneio.config import FrontendConfig
from asyneio.frontend.detection import SCRATCH, is_corner
from asyneio.frontend.gradient.feature import GradientSettings, try_birth, update
from asyneio.frontend.gradient.features import RING, Features, make_features
from asyneio.frontend.gradient.patch import make_workspace
from asyneio.frontend.gradient.state import LoopSettings, Roll
from asyneio.frontend.surface import NEVER_NS
from asyneio.frontend.tracker import Record, record_of
from asyneio.jit import njit
from asyneio.types import RecordArray

MS = 1_000_000


@njit(cache=True)
def first_template(
    features: Features, angle: float, rate: float, reach_px: int, settings: RecordArray, work: RecordArray
) -> bool:
    """`try_birth`, callable from Python."""
    return try_birth(features, np.int64(0), Roll(angle, rate), reach_px, settings[0], work[0])


@njit(cache=True)
def match_track(
    features: Features,
    roll: Roll,
    window_px: float,
    loop: RecordArray,
    settings: RecordArray,
    work: RecordArray,
) -> int:
    """`update`, callable from Python: 1 moved, 0 rejected, -1 ended."""
    return update(features, np.int64(0), roll, window_px, loop[0], settings[0], work[0])


@dataclass(eq=False)
class Feature:
    """A feature: a corner and its events, and once it is a track, its id."""

    born_ns: int
    arrays: Features = field(default_factory=lambda: make_features(1))
    id: int | None = None
    fed: int = 0
    last_report_ns: int = NEVER_NS
    confirmed: bool = False
    entered: tuple[float, float] = (0.0, 0.0)

    @property
    def record(self) -> Record:
        """The record that the called parts read and write."""
        return self.arrays.records[0]

    def enter(self) -> None:
        """Enter the feature into the grid where it is now."""
        self.entered = float(self.record["x"]), float(self.record["y"])

    def is_listed(self, x: int, y: int) -> bool:
        """Whether the bucket of 8 px of an event lists the feature: all that lie within 12 px, and 1.5 px for
        its motion, of where it was entered in x and in y."""
        return all(
            math.floor((c - 13.5) / 8) <= e // 8 <= math.floor((c + 13.5) / 8)
            for c, e in zip(self.entered, (x, y), strict=True)
        )

    def distance(self, t_ns: int, x: int, y: int) -> float:
        """From where the feature is predicted to be [px]."""
        f, dt = self.record, (t_ns - int(self.record["t_ns"])) * 1e-9
        return math.hypot(x - f["x"] - f["vx"] * dt, y - f["y"] - f["vy"] * dt)


class NaiveFrontend:
    """Algorithm 1, one event at a time; `ended` counts the ends of features by reason."""

    def __init__(self, config: FrontendConfig, width: int, height: int) -> None:
        self.size, self.capacity = (width, height), config.max_features
        self.spacing_px = max(10.0, config.spacing * width)
        self.t_min_ns, self.t_max_ns = (round(1e9 * s) for s in (config.min_interval_s, config.max_silence_s))
        self.settings, self.work = (
            record_of(GradientSettings()),
            make_workspace(GradientSettings().mask_sigma_px),
        )
        self.loop = record_of(LoopSettings(width, height, 0, 0.0, 0.0, 0.0, 0, 0, 0, 0))
        self.latest = np.full((height, width, 2), NEVER_NS)
        self.supported = self.latest.copy()
        self.unmeasured, self.rate_hz, self.support_ns, self.window_share = 0, 0.0, 0, 0.05
        self.unsupported, self.noise_events, self.unsupported_share, self.window_px = 0, 0, 0.0, 2.0
        self.stretches = self.filters = True
        self.fired: dict[tuple[int, int], int] = {}
        self.hot: set[tuple[int, int]] = set()
        self.features: list[Feature] = []
        self.ended = dict.fromkeys(("abandoned", "silent", "crowded", "border", "untrusted"), 0)
        self.corners = self.tracks = self.hot_events = self.roll_ns = self.fed = 0
        self.roll, self.tests = 0.0, 0.0
        self.managed_ns = self.hot_ns = NEVER_NS
        self.polarity, self.weights = [0.0, 0.0], [-1.0, 1.0]
        self.reports: list[tuple[int, int, float, float]] = []

    def process(self, t_ns: int, x: int, y: int, p: int, roll_rate: float) -> None:
        """One event; `reports` then holds what it led to: (t_ns, id, u, v)."""
        self.reports = []
        self.roll += roll_rate * (t_ns - self.roll_ns) * 1e-9 if self.roll_ns else 0.0
        self.roll_ns = t_ns
        if t_ns - self.managed_ns > 5 * MS:
            self.manage_tracks(t_ns)
        self.latest[y, x, p] = t_ns
        self.fired[x, y] = self.fired.get((x, y), 0) + 1
        if (x, y) in self.hot:
            self.hot_events += 1
            return
        self.unmeasured += 1
        supported = self.is_supported(t_ns, x, y, p)
        if not supported:
            self.unsupported += 1
            if self.unsupported_share > 0.32 and self.filters:
                self.noise_events += 1
                return
        self.polarity[p] += 1
        first_of_edge = supported and self.is_first_of_edge(t_ns, x, y, p)
        distances = [(f.distance(t_ns, x, y), f) for f in self.features if f.is_listed(x, y)]
        for distance, feature in distances:
            if distance <= 12.0:
                self.feed(feature, t_ns, x, y, p, roll_rate)
        if any(distance < self.spacing_px for distance, _ in distances) or not first_of_edge:
            return
        if len(self.features) < self.capacity and self.is_inside(x, y, 9) and self.tests >= 1.0:
            self.tests -= 1.0
            if is_corner(self.supported, p, x, y, np.empty(SCRATCH, dtype=np.int64)):
                self.begin(t_ns, x, y)

    def is_supported(self, t_ns: int, x: int, y: int, p: int) -> bool:
        """Whether a neighbour fired shortly before, or the event is at the border of the image."""
        if not self.is_inside(x, y, 1):
            return True
        around = self.latest[y - 1 : y + 2, x - 1 : x + 2, p].copy()
        around[1, 1] = NEVER_NS
        return t_ns - int(around.max()) <= self.support_ns

    def is_first_of_edge(self, t_ns: int, x: int, y: int, p: int) -> bool:
        """Among the events with support."""
        before = self.supported[y, x].copy()
        self.supported[y, x, p] = t_ns
        return bool(before[1 - p] > before[p] or t_ns - before[p] > 50 * MS)

    def begin(self, t_ns: int, x: int, y: int) -> None:
        """A feature at a corner."""
        feature = Feature(t_ns, last_report_ns=t_ns - 1_000 * MS)
        f = feature.record
        f["x"], f["y"], f["t_ns"], f["stride"], f["due"] = x, y, t_ns, 1, 150
        f["u1"] = f["v1"] = 22
        feature.enter()
        self.features.append(feature)
        self.corners += 1

    def feed(self, feature: Feature, t_ns: int, x: int, y: int, p: int, roll_rate: float) -> None:
        """Keep one event in `stride`, and act once enough are kept."""
        f = feature.record
        self.fed += 1
        feature.fed += 1
        f["skipped"] += 1
        if f["skipped"] < f["stride"]:
            return
        ring = feature.arrays.rings[0]
        ring[f["written"] % RING] = t_ns, x, y, self.weights[p] * int(f["stride"])
        f["skipped"] = 0
        f["written"] += 1
        f["fresh"] += 1
        if f["fresh"] < f["due"]:
            return
        if feature.id is None:
            self.try_to_track(feature, roll_rate)
            return
        roll = Roll(self.roll, roll_rate)
        status = match_track(feature.arrays, roll, self.window_px, self.loop, self.settings, self.work)
        if not self.is_inside(f["x"], f["y"], 6):
            self.end(feature, "border")
        elif status < 0:
            self.end(feature, "untrusted")
        elif status > 0:
            feature.enter()
            self.report(feature)

    def try_to_track(self, feature: Feature, roll_rate: float) -> None:
        """A corner becomes a track; the search for its velocity begins with that of three tracks nearby."""
        x, y = feature.record["x"], feature.record["y"]
        tracks = [f.record for f in self.features if f.id is not None]
        near = sorted((((x - f["x"]) ** 2 + (y - f["y"]) ** 2, k) for k, f in enumerate(tracks)))[:3]
        guess = len(near) == 3 and near[2][0] < (0.25 * self.size[0]) ** 2
        for name in ("vx", "vy"):
            a, b, c = (tracks[k][name] for _, k in near) if guess else (0.0, 0.0, 0.0)
            self.work[0][name] = (a + b + c) / 3.0
        reach_px = 2 if guess else 5
        if first_template(feature.arrays, self.roll, roll_rate, reach_px, self.settings, self.work):
            feature.id, self.tracks = self.tracks, self.tracks + 1
            feature.enter()

    def report(self, feature: Feature) -> None:
        """Observations at least `t_min` apart; the first match also confirms the position at the birth."""
        f, roll = feature.record, float(self.work[0]["roll"])
        if not feature.confirmed:
            feature.confirmed, feature.last_report_ns = True, int(f["seed_ns"])
            self.write(feature, feature.last_report_ns, float(f["seed_u"]), float(f["seed_v"]))
            f["seed_ns"] = 0
        if f["t_ns"] - feature.last_report_ns >= self.t_min_ns:
            feature.last_report_ns = int(f["t_ns"])
            c, s = math.cos(roll), math.sin(roll)
            ahead = 0.2 * f["lag"] / max(math.hypot(f["vx"], f["vy"]), 1e-3)
            u = f["x"] + c * f["offset_x"] - s * f["offset_y"] + ahead * f["vx"]
            v = f["y"] + s * f["offset_x"] + c * f["offset_y"] + ahead * f["vy"]
            self.write(feature, feature.last_report_ns, float(u), float(v))

    def write(self, feature: Feature, t_ns: int, u: float, v: float) -> None:
        """An observation, if it lies inside the image."""
        if self.is_inside(u, v, 0):
            assert feature.id is not None
            self.reports.append((t_ns, feature.id, u, v))

    def is_inside(self, x: float, y: float, margin: int) -> bool:
        """Whether a position is at least `margin` [px] inside the image."""
        return all(margin <= c <= n - 1 - margin for c, n in zip((x, y), self.size, strict=True))

    def end(self, feature: Feature, reason: str) -> None:
        """A feature ends."""
        self.features.remove(feature)
        self.ended[reason] += 1

    def manage_tracks(self, t_ns: int) -> None:
        """Every 5 ms: corners that never moved, silent tracks, the younger of two tracks within 5 px."""
        self.tests = min(20_000.0, self.tests + 200_000.0 * ((t_ns - self.managed_ns) * 1e-9))
        elapsed_ns = t_ns - self.managed_ns
        rate_hz = self.unmeasured * 1_000 * MS / elapsed_ns
        self.rate_hz += (rate_hz - self.rate_hz) * elapsed_ns / (elapsed_ns + 100 * MS)
        between_s = 2 * self.size[0] * self.size[1] / max(self.rate_hz, 1.0)
        self.support_ns = int(min(self.window_share * between_s * 1e9, 1e12))
        if self.unmeasured:
            change = self.unsupported / self.unmeasured - self.unsupported_share
            self.unsupported_share += change * elapsed_ns / (elapsed_ns + 100 * MS)
            noise = (self.unsupported_share - 0.2) / (0.8 - 0.2)
            longer = self.stretches and self.unsupported_share > 0.32
            self.window_px = 2.0 / (1.0 - min(max(noise, 0.0), 0.5)) if longer else 2.0
        self.unmeasured = self.unsupported = 0
        self.managed_ns = t_ns
        for feature in list(self.features):
            f = feature.record
            if feature.id is None:
                if t_ns - feature.born_ns > 250 * MS:
                    self.end(feature, "abandoned")
            elif t_ns - f["t_ns"] > self.t_max_ns:
                self.end(feature, "silent")
            elif any(
                math.hypot(f["x"] - g.record["x"], f["y"] - g.record["y"]) < 5.0
                for g in self.features
                if g.id is not None and g.born_ns < feature.born_ns
            ):
                self.end(feature, "crowded")
        if sum(self.polarity) > 20_000:
            ratio = min(max(math.sqrt(max(self.polarity[0], 1.0) / max(self.polarity[1], 1.0)), 0.5), 2.0)
            self.weights, self.polarity = [-1.0 / ratio, ratio], [0.5 * n for n in self.polarity]
        if t_ns - self.hot_ns > 1_000 * MS:
            self.hot = self.find_hot((t_ns - self.hot_ns) * 1e-9)
            self.fired, self.hot_ns = {}, t_ns

    def find_hot(self, seconds: float) -> set[tuple[int, int]]:
        """Pixels above 25 Hz that fire five times as often as their second busiest neighbour."""
        steps = [(i, j) for i in (-1, 0, 1) for j in (-1, 0, 1) if i or j]
        busy = {place: n for place, n in self.fired.items() if n > 25.0 * seconds}
        neighbours = {
            (x, y): sorted(self.fired.get((x + i, y + j), 0) for i, j in steps)[-2] for x, y in busy
        }
        return {place for place, n in busy.items() if n > 5.0 * neighbours[place]}
