# SPDX-License-Identifier: Apache-2.0
"""The process environment of a command: environment variables, and output streams that may be closed
early."""

from __future__ import annotations

import io
import os
import sys
from typing import Any, TextIO

#: Disables numba's compilation. Some kernels do not run without it, and the estimator is unusably slow.
_NO_COMPILATION = "NUMBA_DISABLE_JIT"
_THREADS = "NUMBA_NUM_THREADS"
#: Width of the terminal, and the smallest that tables fit into.
_COLUMNS, _LEAST_COLUMNS = "COLUMNS", 20


def prepare_environment() -> None:
    """Set what must be set before numpy and numba are imported; print a note on what is overridden.

    Linear algebra uses one thread, unless the user has set another number. The matrices of the window are
    small: a second thread gains little on an idle machine, is up to fifty times slower on a busy one
    (measured), and makes results depend on the number of cores.
    """
    for variable in ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "VECLIB_MAXIMUM_THREADS"):
        os.environ.setdefault(variable, "1")
    # Rich prints nothing in zero columns.
    columns = os.environ.get(_COLUMNS, "")
    if columns and (not columns.isdigit() or int(columns) < _LEAST_COLUMNS):
        del os.environ[_COLUMNS]
    threads = os.environ.get(_THREADS, "")
    if threads and (not threads.isdigit() or int(threads) < 1):
        del os.environ[_THREADS]
        print(f"note: {_THREADS}={threads} is ignored: expected 1 or more", file=sys.stderr)
    if os.environ.pop(_NO_COMPILATION, "0") not in ("", "0"):
        print(f"note: {_NO_COMPILATION} is ignored: asyneio requires compiled code", file=sys.stderr)


def prepare_streams() -> None:
    """Replace standard output and error by streams that never fail.

    If the reader closes the pipe (`asyneio doctor RECORDING | head`), the command continues, writes its files
    and exits with its own status. Characters that the terminal cannot display are escaped.
    """
    sys.stdout, sys.stderr = _tolerant(sys.stdout), _tolerant(sys.stderr)


def lost_output() -> str:
    """Write what is left in the buffers; the reason if standard output could not be written, else empty."""
    sys.stdout.flush()
    raw = getattr(getattr(sys.stdout, "buffer", None), "raw", None)
    return raw.failure if isinstance(raw, _PipeWriter) else ""


def _tolerant(stream: TextIO) -> TextIO:
    try:
        file_number = stream.fileno()
    except (OSError, ValueError, AttributeError):
        # The stream is not a file: it was replaced, for example by a test, or there is none.
        return stream
    raw = _PipeWriter(file_number)
    return io.TextIOWrapper(
        io.BufferedWriter(raw),
        encoding=stream.encoding,
        errors="backslashreplace",
        line_buffering=raw.isatty() or stream is sys.stderr,
    )


class _PipeWriter(io.RawIOBase):
    """An open file for writing. After the reader has closed the pipe, or an error, output is discarded.

    Attributes:
        failure: the error, such as a full disk; empty if there was none.
    """

    def __init__(self, file_number: int) -> None:
        self._file_number = file_number
        self.failure = ""

    def fileno(self) -> int:
        """The number of the open file."""
        return self._file_number

    def writable(self) -> bool:
        """True: the buffer of a text stream requires it."""
        return True

    def isatty(self) -> bool:
        """Whether a terminal shows the output."""
        return os.isatty(self._file_number)

    def write(self, data: Any) -> int:
        """Write the bytes; discard them once the pipe is closed, so that the exit status stays, and after an
        error."""
        try:
            return os.write(self._file_number, data)
        except OSError as error:
            if not isinstance(error, BrokenPipeError):
                self.failure = error.strerror or str(error)
            null = os.open(os.devnull, os.O_WRONLY)
            os.dup2(null, self._file_number)
            os.close(null)
            return len(memoryview(data).cast("B"))
