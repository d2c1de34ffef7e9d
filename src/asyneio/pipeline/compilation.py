# SPDX-License-Identifier: Apache-2.0
"""Compilation of the numerical kernels: before a run, on two cores, with its duration.

Numba caches compiled kernels on disk, so this matters for the first run after installation only. Two groups
of `pipeline.kernels` that share little with the others are compiled in a child process.
"""

from __future__ import annotations

import gc
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import Any

from numba.core import config as numba_config
from numba.core import event as numba_event

from asyneio.pipeline.kernels import (
    are_compiled,
    compile_frontend,
    compile_intervals,
    compile_linearization,
    compile_start,
    compile_visual,
)
from asyneio.progress import ProgressCallback, RunProgress

COMPILING = "Compiling numerical kernels (first run after installation, about a minute) ..."

#: What a child process runs.
_CHILD = "from asyneio.pipeline import compilation; compilation.in_child()"
#: Number of kernels and their specializations that a cold start compiles, in all processes.
COMPILED = 334


def compile_kernels(progress: ProgressCallback) -> None:
    """Compile the kernels of estimator and front end, two groups of them in a child process.

    `progress` is called from two threads.
    """
    done = _Count(progress)
    with (
        numba_event.install_listener("numba:compile", done),
        subprocess.Popen([sys.executable, "-c", _CHILD], stdout=subprocess.PIPE) as child,
        _no_garbage_collection(),
    ):
        assert child.stdout is not None
        reader = threading.Thread(target=done.count_lines, args=(child.stdout,), daemon=True)
        reader.start()
        compile_intervals()
        compile_visual()
        compile_linearization()
        # The output of the child ends when the child exits.
        reader.join()
    # Loads what the child has compiled; compiles it if the child failed.
    compile_frontend()
    compile_start()


def in_child() -> None:
    """Compile the other groups; write a line to standard output for each kernel."""
    counter = _Count(lambda _: print(flush=True))
    with numba_event.install_listener("numba:compile", counter), _no_garbage_collection():
        compile_frontend()
        compile_start()


@contextmanager
def _no_garbage_collection() -> Iterator[None]:
    """Collections would scan Numba's large data structures again and again: 8 % of the time."""
    collects = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if collects:
            gc.enable()


class _Count(numba_event.Listener):
    """Counts the kernels compiled in this process and in children that write a line for each."""

    def __init__(self, progress: ProgressCallback) -> None:
        self._progress = progress
        self._done = 0
        self._lock = threading.Lock()

    def on_start(self, event: Any) -> None:
        """Ignored: kernels count when they are done."""

    def on_end(self, event: Any) -> None:
        """Count a compiled kernel."""
        with self._lock:
            self._done += 1
            self._progress(min(self._done / COMPILED, 1.0))

    def count_lines(self, lines: Iterable[bytes]) -> None:
        """Count lines until they end."""
        for _ in lines:
            self.on_end(None)


class Compilation(numba_event.Listener):
    """Adds up the time Numba spends compiling, and announces the beginning. Cached kernels raise no event."""

    def __init__(self, announce: Callable[[], None]) -> None:
        self.seconds = 0.0
        self._announce = announce
        self._depth = 0
        self._started = 0.0

    def on_start(self, event: Any) -> None:
        """Start the clock; kernels called by this one are compiled inside."""
        if self._depth == 0:
            if self.seconds == 0.0:
                self._announce()
            self._started = time.perf_counter()
        self._depth += 1

    def on_end(self, event: Any) -> None:
        """Stop the clock at the outermost kernel."""
        self._depth -= 1
        if self._depth == 0:
            self.seconds += time.perf_counter() - self._started


@contextmanager
def watch_compilation(progress: RunProgress) -> Iterator[Compilation]:
    """Measure the compilation inside the block."""
    compilation = Compilation(lambda: progress.message(COMPILING))
    with numba_event.install_listener("numba:compile", compilation):
        yield compilation


def compile_ahead(compilation: Compilation, progress: RunProgress) -> None:
    """With a cold cache, compile on two cores what the run would otherwise compile on one."""
    if numba_config.DISABLE_JIT or are_compiled():
        return
    # Waiting for the children counts as well, so the whole call is one event.
    compilation.on_start(None)
    compile_kernels(progress.compiling)
    compilation.on_end(None)
