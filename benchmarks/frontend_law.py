"""Cost of an event in the front end, by size of the sensor, event rate and number of features.

    python benchmarks/frontend_law.py [--sizes 240x180 640x480 1280x720] [--rates 1.1 10 30]
        [--features 8 25 100] [--millions 4] [--repeats 3] [--load 0.3] [--cache DIR] [--markdown FILE]

Kind of evidence: simulation (`suite_fine_6dof`, the same scene and motion at all sizes). Times are scaled to
give the requested event rate: the same image moves slower or faster. Costs are processor time of the thread
of the front end, without reading: the minimum of repeated runs, packet by packet.

The last lines fit `ns per event = a + b n`, where `n` is the mean number of features that an event is fed to,
and show what is dropped under `frontend.max_load`, and the cost of the rest.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from asyneio.config import FrontendConfig
from asyneio.frontend import Frontend, FrontendStatistics
from asyneio.io.parsing.atomic import write_text
from asyneio.simulation import EVENT_SCENARIOS
from asyneio.simulation.events.scenario import at_resolution
from asyneio.types import RecordArray
from common import table
from frontend_speed import packets
from sequences import DEFAULT_CACHE, cached_sequence

HEADER = ["sensor", "Mev/s", "features", "alive", "fed to", "ns per event", "share of a core", "untested"]
SHED_HEADER = ["sensor", "Mev/s", "max_load", "alive", "ns per event", "share of a core", "events shed %"]
SHED_HEADER += ["near features %", "features shed"]


def stretched(events: RecordArray, mev_s: float) -> RecordArray:
    """The same events at another mean rate."""
    out = np.array(events)
    t_ns = out["t_ns"] - out["t_ns"][0]
    out["t_ns"] = np.rint(t_ns * (1e3 * out.size / mev_s / float(t_ns[-1]))).astype(np.int64)
    return out


def cost(
    events: RecordArray, size: tuple[int, int], config: FrontendConfig, repeats: int
) -> tuple[float, float, FrontendStatistics]:
    """CPU time per event [ns], median number of live features, and counts."""
    pieces = packets(events)
    spent = np.zeros((repeats, len(pieces)))
    for row in spent:
        frontend, alive = Frontend(config, *size), []
        for k, piece in enumerate(pieces):
            started = time.thread_time()
            frontend.process(piece)
            row[k] = time.thread_time() - started
            alive.append(frontend.statistics().alive)
    return spent.min(axis=0).sum() / events.size * 1e9, float(np.median(alive)), frontend.statistics()


def law_rows(
    events: RecordArray, size: tuple[int, int], mev_s: float, features: Sequence[int], repeats: int
) -> tuple[list[list[str]], list[tuple[float, float]]]:
    """Rows for some numbers of features; (features fed, ns) per event of each."""
    rows, points = [], []
    for count in features:
        ns, alive, counts = cost(events, size, FrontendConfig(max_features=count), repeats)
        fed = counts.fed / counts.events
        points.append((fed, ns))
        rows.append(
            [
                f"{size[0]} x {size[1]}",
                f"{mev_s:g}",
                str(count),
                f"{alive:.0f}",
                f"{fed:.3f}",
                f"{ns:.1f}",
                f"{ns * mev_s * 1e-3:.2f}",
                f"{counts.untested}",
            ]
        )
    return rows, points


def shed_row(
    events: RecordArray, size: tuple[int, int], mev_s: float, load: float, repeats: int
) -> list[str]:
    """What is shed with a limit of the load."""
    ns, alive, counts = cost(events, size, FrontendConfig(max_load=load), repeats)
    return [
        f"{size[0]} x {size[1]}",
        f"{mev_s:g}",
        f"{load:g}",
        f"{alive:.0f}",
        f"{ns:.1f}",
        f"{ns * mev_s * 1e-3:.2f}",
        f"{100.0 * counts.shed_events / counts.events:.0f}",
        f"{100.0 * counts.shed_feature_events / counts.events:.0f}",
        str(counts.shed_features),
    ]


def main() -> None:
    """Print both tables and the law."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--sizes", nargs="+", default=["240x180", "640x480", "1280x720"])
    parser.add_argument("--rates", type=float, nargs="+", default=[1.1, 10.0, 30.0], help="Mev/s, by size")
    parser.add_argument("--features", type=int, nargs="+", default=[8, 25, 100])
    parser.add_argument("--millions", type=float, default=4.0, help="of events of a sequence")
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--load", type=float, default=0.3, help="limit of the second table")
    parser.add_argument("--cache", type=Path, default=DEFAULT_CACHE)
    parser.add_argument("--markdown", type=Path, help="also write the tables here")
    options = parser.parse_args()
    rows, shed, points = [], [], []
    for name, mev_s in zip(options.sizes, options.rates, strict=True):
        width, height = map(int, name.split("x"))
        base = at_resolution(EVENT_SCENARIOS["suite_fine_6dof"], width, height)
        scene = replace(base, duration_s=6.0, largest_step_px=1.0)
        recording = cached_sequence(scene, options.cache).recording
        events = stretched(recording.events[: int(options.millions * 1e6)], mev_s)
        more, found = law_rows(events, (width, height), mev_s, options.features, options.repeats)
        rows += more
        points += found
        shed.append(shed_row(events, (width, height), mev_s, options.load, options.repeats))
    text = report(rows, shed, points)
    print(text)
    if options.markdown:
        write_text(options.markdown, text)


def report(rows: list[list[str]], shed: list[list[str]], points: list[tuple[float, float]]) -> str:
    """Both tables and the law."""
    fed, ns = np.array(points).T
    (a, b), *_ = np.linalg.lstsq(np.column_stack([np.ones_like(fed), fed]), ns, rcond=None)
    left = np.abs(a + b * fed - ns).max()
    law = f"ns per event = {a:.1f} + {b:.1f} n, largest deviation {left:.1f}"
    return f"{table(HEADER, rows)}\n\n{law}\n\n{table(SHED_HEADER, shed)}\n"


if __name__ == "__main__":
    main()
