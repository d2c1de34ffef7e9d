"""A run made up for plots: a turn of a helix, with or without truth."""

from __future__ import annotations

import numpy as np

from asyneio.types import EVENT_DTYPE, OBSERVATION_DTYPE
from asyneio.viz import (
    Comparison,
    EventRate,
    Features,
    HealthChange,
    HealthTimeline,
    ReportData,
    Series,
    States,
    Timing,
    TrackScene,
)

STATES = ("initializing", "tracking", "degraded", "lost")


def make_data(size: int = 60, with_truth: bool = True) -> ReportData:
    """`size` steps; position errors of centimetres."""
    t_s = np.linspace(0.5, 3.0, size)
    path = np.stack([np.cos(t_s), 2.0 * np.sin(t_s), 0.1 * t_s], axis=1)
    series = Series(t_s, path, np.full((size, 3), 0.1), path if with_truth else None)
    error = Series(t_s, 0.01 * path, np.full((size, 3), 0.02))
    changes = (
        HealthChange(0.5, "initializing", 0, "no motion"),
        HealthChange(2.0, "lost", 0, "speed of 80 m/s"),
    )
    return ReportData(
        health=HealthTimeline(t_s, np.arange(size) * 4 // size, np.arange(size) * 2 // size, STATES, changes),
        features=Features(t_s, np.arange(size), np.tile([0.1, 0.2, 0.4], (size, 1))),
        timing=Timing(t_s, np.full(size, 0.004), 0.05),
        states=States((path,), series, series, series),
        comparison=Comparison(path, path + 0.01, error, error) if with_truth else None,
        events=EventRate(t_s, 1e6 * (1.0 + np.sin(9.0 * t_s))),
        scene=make_scene(),
        settings=(("window.length_s", "2.0 (default: 1.5)"),),
        notes=("imu.csv: skipped 1 line",),
    )


def make_scene() -> TrackScene:
    """One track across a small sensor."""
    events = np.zeros(500, dtype=EVENT_DTYPE)
    events["t_ns"] = np.arange(500) * 4_000_000
    events["x"], events["y"] = np.arange(500) % 60, np.arange(500) % 40
    rows = np.zeros(100, dtype=OBSERVATION_DTYPE)
    rows["t_ns"] = np.arange(100) * 20_000_000
    rows["u"], rows["v"] = np.linspace(5.0, 55.0, 100), 20.0
    return TrackScene(events, 60, 40, rows)
