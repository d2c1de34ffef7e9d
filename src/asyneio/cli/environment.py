"""The surroundings of a command: variables of the environment, and streams that nobody reads any more."""

from __future__ import annotations

import io
import os
import sys
from typing import Any, TextIO

#: Compiled code is what makes the estimator usable; its kernels do not even run without being compiled.
_NO_COMPILATION = "NUMBA_DISABLE_JIT"


def prepare_environment() -> None:
    """Settings that must come before numpy and numba are imported; what cannot be obeyed is said.

    One thread for linear algebra, unless the user has chosen otherwise: the window's matrices are small, so a
    second one gains little on an idle machine, waits for its share of a busy one (measured: fifty times
    slower), and makes results depend on the number of cores.
    """
    for variable in ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "VECLIB_MAXIMUM_THREADS"):
        os.environ.setdefault(variable, "1")
    if os.environ.pop(_NO_COMPILATION, "0") not in ("", "0"):
        print(f"note: {_NO_COMPILATION} is ignored: asyneio runs compiled code only", file=sys.stderr)


def prepare_streams() -> None:
    """Standard output and error that never fail.

    Who reads them may stop reading (`asyneio doctor RECORDING | head`): the command goes on, writes its files
    and ends with its own status. Characters that the terminal cannot show are escaped.
    """
    sys.stdout, sys.stderr = _steady(sys.stdout), _steady(sys.stderr)


def _steady(stream: TextIO) -> TextIO:
    try:
        file_number = stream.fileno()
    except (OSError, ValueError, AttributeError):
        # Somebody has put a stream of his own in place of it, or there is none.
        return stream
    raw = _Unread(file_number)
    return io.TextIOWrapper(
        io.BufferedWriter(raw),
        encoding=stream.encoding,
        errors="backslashreplace",
        line_buffering=raw.isatty() or stream is sys.stderr,
    )


class _Unread(io.RawIOBase):
    """An open file to write to; once nobody reads it any more, what is written is thrown away."""

    def __init__(self, file_number: int) -> None:
        self._file_number = file_number

    def fileno(self) -> int:
        return self._file_number

    def writable(self) -> bool:
        return True

    def isatty(self) -> bool:
        return os.isatty(self._file_number)

    def write(self, data: Any) -> int:
        try:
            return os.write(self._file_number, data)
        except BrokenPipeError:
            nowhere = os.open(os.devnull, os.O_WRONLY)
            os.dup2(nowhere, self._file_number)
            os.close(nowhere)
            return len(memoryview(data).cast("B"))
