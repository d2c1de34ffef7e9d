"""Compilation of the numerical kernels: ahead of use, on two cores, and how long it took.

Numba keeps compiled kernels on disk, so this matters for the first run after installation alone. Each group
of `pipeline.kernels` is compiled by a process of its own, one of them here, and everything else finds its
parts in the cache.
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
#: So many kernels and specialisations of kernels are compiled on a cold start, all processes together.
COMPILED = 375


def compile_kernels(progress: ProgressCallback) -> None:
    """Compile the kernels of the linearisation and of the front end, most of them in child processes.

    `progress` is called with the share done, 0 to 1, from any thread.
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
        # A child's output ends with the child.
        for reader in readers:
            reader.join()
        compile_start()
        compile_linearization()


def in_child(compile_group: Callable[[], None]) -> None:
    """Compile a group, with a line on standard output for each kernel."""
    with numba_event.install_listener("numba:compile", _Count(lambda _: print(flush=True))):
        compile_group()


class _Count(numba_event.Listener):
    """Counts compiled kernels, of this process and of others that write a line for each."""

    def __init__(self, tell: ProgressCallback) -> None:
        self._tell = tell
        self._done = 0
        self._lock = threading.Lock()

    def on_start(self, event: Any) -> None:
        """A kernel begins to compile."""

    def on_end(self, event: Any) -> None:
        """A kernel is compiled."""
        with self._lock:
            self._done += 1
            self._tell(min(self._done / COMPILED, 1.0))

    def count_lines(self, lines: Iterable[bytes]) -> None:
        """Until they end."""
        for _ in lines:
            self.on_end(None)


class Compilation(numba_event.Listener):
    """Adds up the time that Numba spends compiling; says so when it begins. Cached kernels raise no event."""

    def __init__(self, announce: Callable[[], None]) -> None:
        self.seconds = 0.0
        self._announce = announce
        self._depth = 0
        self._started = 0.0

    def on_start(self, event: Any) -> None:
        """A kernel begins to compile; kernels it calls nest inside."""
        if self._depth == 0:
            if self.seconds == 0.0:
                self._announce()
            self._started = time.perf_counter()
        self._depth += 1

    def on_end(self, event: Any) -> None:
        """A kernel is compiled."""
        self._depth -= 1
        if self._depth == 0:
            self.seconds += time.perf_counter() - self._started


@contextmanager
def watch_compilation(progress: RunProgress) -> Iterator[Compilation]:
    """Measure what is compiled inside the block."""
    compilation = Compilation(lambda: progress.message(COMPILING))
    with numba_event.install_listener("numba:compile", compilation):
        yield compilation


def compile_ahead(compilation: Compilation, progress: RunProgress) -> None:
    """On a cold cache, compile on two cores what the run would otherwise compile on one, bit by bit."""
    if numba_config.DISABLE_JIT or are_compiled():
        return
    # The wait for the other process counts as well, so the whole call stands as one event.
    compilation.on_start(None)
    compile_kernels(progress.compiling)
    compilation.on_end(None)
