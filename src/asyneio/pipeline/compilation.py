# SPDX-License-Identifier: Apache-2.0
"""Compilation of the numerical kernels: before a run, on two cores, with its duration.

Numba caches compiled kernels on disk, so this matters for the first run after installation only. Each group
of `pipeline.kernels` is compiled in its own process, one of them in this one; later groups find shared parts
in the cache.
"""

from __future__ import annotations

import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack, contextmanager
from typing import Any

from numba.core import config as numba_config
from numba.core import event as numba_event

from asyneio.pipeline.kernels import are_compiled, compile_intervals, compile_linearization, compile_start
from asyneio.progress import ProgressCallback, RunProgress

COMPILING = "Compiling numerical kernels (first run after installation, about a minute) ..."

#: What child processes compile.
_IN_CHILDREN = ("compile_visual", "compile_frontend")
#: Number of kernels and their specializations that a cold start compiles, in all processes.
COMPILED = 375


def compile_kernels(progress: ProgressCallback) -> None:
    """Compile the kernels of estimator and front end, two groups of them in child processes.

    `progress` is called from several threads.
    """
    done = _Count(progress)
    with numba_event.install_listener("numba:compile", done), ExitStack() as stack:
        readers = []
        for name in _IN_CHILDREN:
            code = "from asyneio.pipeline import compilation, kernels; compilation.in_child(kernels.{})"
            command = [sys.executable, "-c", code.format(name)]
            child = stack.enter_context(subprocess.Popen(command, stdout=subprocess.PIPE))
            assert child.stdout is not None
            readers.append(threading.Thread(target=done.count_lines, args=(child.stdout,), daemon=True))
            readers[-1].start()
        compile_intervals()
        # The output of a child ends when the child exits.
        for reader in readers:
            reader.join()
        compile_start()
        compile_linearization()


def in_child(compile_group: Callable[[], None]) -> None:
    """Compile a group; write a line to standard output for each kernel."""
    with numba_event.install_listener("numba:compile", _Count(lambda _: print(flush=True))):
        compile_group()


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
