"""How the default tracker spends its time: nanoseconds per event and stage.

    python benchmarks/frontend_stages.py [--scenes event_fast] [--excerpts ecd_excerpts/boxes_translation ...]
        [--seconds 2] [--cache DIR] [--markdown FILE]

The stages of the event loop are wrapped with reads of the processor's cycle counter and compiled into a
separate cache, in this process only. The figures include the cost of the wrappers; the installed kernels are
not affected.

Kind of evidence: as `frontend_speed.py`: simulated events, and real excerpts repeated end to end.
"""

from __future__ import annotations

import argparse
import os
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

# Set before the front end is imported, to keep wrapped kernels out of the normal cache.
_KERNELS = tempfile.TemporaryDirectory(prefix="asyneio-stages-")
os.environ["NUMBA_CACHE_DIR"] = _KERNELS.name

import numba as nb  # noqa: E402
import numpy as np  # noqa: E402
from llvmlite import ir  # noqa: E402
from numba.core import types  # noqa: E402
from numba.extending import intrinsic  # noqa: E402

from asyneio.config import FrontendConfig  # noqa: E402
from asyneio.frontend import Frontend, surface  # noqa: E402
from asyneio.frontend.gradient import feature as gradient_feature  # noqa: E402
from asyneio.frontend.gradient import kernel as gradient_kernel  # noqa: E402
from asyneio.io.parsing.atomic import write_text  # noqa: E402
from asyneio.types import EventRecording, RecordArray  # noqa: E402
from common import table  # noqa: E402
from frontend_speed import EXCERPTS, REPEATED_EVENTS, packets, repeated  # noqa: E402
from real_tracking import load  # noqa: E402
from sequences import DEFAULT_CACHE, sequence  # noqa: E402

#: Stage, module, function. Stages "A: B" are parts of stage A and are subtracted from it below.
STAGES = (
    ("corner test", gradient_kernel, "is_corner"),
    ("track management", gradient_kernel, "remove_idle"),
    ("track management", surface, "refresh_hot_pixels"),
    ("birth", gradient_kernel, "try_birth"),
    ("birth: velocity", gradient_feature, "find_flow"),
    ("update", gradient_kernel, "update"),
    ("update: window of events", gradient_feature, "newest_events"),
    ("update: draw", gradient_feature, "draw_patch"),
    ("update: blur", gradient_feature, "blur"),
    ("update: template", gradient_feature, "synthesise"),
    ("update: match", gradient_feature, "match"),
    ("update: lag", gradient_feature, "seen_lag"),
    ("update: learn", gradient_feature, "learn"),
)
#: Cycles and calls of each entry of STAGES.
_COUNTS = np.zeros((len(STAGES), 2), dtype=np.int64)


@intrinsic
def _cycles(_context: Any) -> Any:
    """The processor's cycle counter."""

    def codegen(_ctx: Any, builder: Any, _sig: Any, _args: Any) -> Any:
        kind = ir.FunctionType(ir.IntType(64), [])
        return builder.call(builder.module.declare_intrinsic("llvm.readcyclecounter", fnty=kind), [])

    return types.int64(), codegen


@intrinsic
def _charge(_context: Any, _stage: Any, _spent: Any) -> Any:
    """Add cycles, and one call, to a stage."""
    base = _COUNTS.ctypes.data

    def codegen(_ctx: Any, builder: Any, _sig: Any, args: Any) -> Any:
        word = ir.IntType(64)
        for offset, amount in ((0, args[1]), (8, ir.Constant(word, 1))):
            row = builder.mul(args[0], ir.Constant(word, 16))
            address = builder.add(row, ir.Constant(word, base + offset))
            pointer = builder.inttoptr(address, word.as_pointer())
            builder.store(builder.add(builder.load(pointer), amount), pointer)
        return ir.Constant(word, 0)

    return types.int64(types.int64, types.int64), codegen


def _wrapped(function: Callable[..., Any], stage: int) -> Callable[..., Any]:
    @nb.njit
    def timed(*arguments: Any) -> Any:
        start = _cycles()
        result = function(*arguments)
        _charge(stage, _cycles() - start)
        return result

    return timed


def wrap_stages() -> None:
    """Replace the stages by wrapped functions; must be called before the event loop is compiled."""
    for k, (_, module, name) in enumerate(STAGES):
        setattr(module, name, _wrapped(getattr(module, name), k))


def seconds_of(recording: EventRecording, pieces: list[RecordArray]) -> float:
    """One run over packets, with 100 features."""
    frontend = Frontend(FrontendConfig(max_features=100), recording.width, recording.height)
    started = time.perf_counter()
    for piece in pieces:
        frontend.process(piece)
    return time.perf_counter() - started


def stage_lines(recording: EventRecording, events: RecordArray) -> dict[str, tuple[float, float, float]]:
    """Of each stage: ns per event, µs per call, calls per 1000 events; the event loop is the remainder."""
    pieces = packets(events)
    seconds_of(recording, pieces[:20])
    _COUNTS[:] = 0
    cycles = _read_cycles()
    seconds = seconds_of(recording, pieces)
    ns_per_cycle = seconds * 1e9 / (_read_cycles() - cycles)
    spent: dict[str, float] = {}
    calls: dict[str, int] = {}
    for (stage, _, _), (ticks, count) in zip(STAGES, _COUNTS.tolist(), strict=True):
        spent[stage] = spent.get(stage, 0.0) + ticks * ns_per_cycle
        calls[stage] = calls.get(stage, 0) + count
    spent["event loop"] = seconds * 1e9 - sum(v for k, v in spent.items() if ":" not in k)
    calls["event loop"] = events.size
    spent["birth"] -= spent["birth: velocity"]
    spent["update"] -= sum(v for k, v in spent.items() if k.startswith("update:"))
    return {
        stage: (ns / events.size, ns / max(calls[stage], 1) * 1e-3, calls[stage] / events.size * 1e3)
        for stage, ns in spent.items()
    }


@nb.njit
def _read_cycles() -> int:
    return _cycles()


def main() -> None:
    """Print a table with one column per recording."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--scenes", nargs="*", default=["event_fast"])
    parser.add_argument("--excerpts", nargs="*", default=list(EXCERPTS))
    parser.add_argument("--seconds", type=float, default=2.0, help="of the simulated sequences")
    parser.add_argument("--cache", type=Path, default=DEFAULT_CACHE)
    parser.add_argument("--markdown", type=Path, help="also write the table here")
    options = parser.parse_args()
    runs: list[tuple[str, EventRecording, RecordArray]] = []
    for scene in options.scenes:
        recording = sequence(scene, 0, options.seconds, options.cache).recording
        runs.append((scene, recording, recording.events))
    for name in options.excerpts:
        recording = load(name)
        runs.append((f"{name}, repeated", recording, repeated(recording.events, REPEATED_EVENTS)))
    wrap_stages()
    columns = {name: stage_lines(recording, events) for name, recording, events in runs}
    stages = list(next(iter(columns.values())))
    rows = [
        [stage, *(f"{column[stage][0]:.0f} ({column[stage][1]:.2f} µs)" for column in columns.values())]
        for stage in sorted(stages, key=lambda s: -max(column[s][0] for column in columns.values()))
    ]
    rows.append(["all", *(f"{sum(line[0] for line in column.values()):.0f}" for column in columns.values())])
    text = "ns per event (µs per call)\n\n" + table(["stage", *columns], rows) + "\n"
    print(text)
    if options.markdown:
        write_text(options.markdown, text)


if __name__ == "__main__":
    main()
