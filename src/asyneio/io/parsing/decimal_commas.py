# SPDX-License-Identifier: Apache-2.0
"""Detection of decimal commas between semicolons, with the command that fixes the file."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

from asyneio.errors import RecordingError

_DECIMAL_COMMA = re.compile(r"(^|[;\s])[+-]?\d+,\d+\s*(;|\s|$)")


def reject_decimal_commas(path: object, number: int, line: str) -> None:
    """Reject a line whose numbers have decimal commas.

    Args:
        path: the file, for the message.
        number: of the line.
        line: its text.

    Raises:
        RecordingError: the line has semicolons between its numbers and commas in them.
    """
    if ";" in line and _DECIMAL_COMMA.search(line):
        raise RecordingError(
            f"{path}: line {number} has decimal commas between semicolons: {line.strip()[:80]!r}; expected "
            f"decimal points. Type: sed -i 's/,/./g; s/;/ /g' {shlex.quote(str(path))}"
        )


def decimal_commas(path: Path, head: bytes) -> str:
    """The error for decimal commas in the first lines of a file; empty if there are none."""
    for number, line in enumerate(head.decode("utf-8", errors="replace").splitlines()[:3], 1):
        try:
            reject_decimal_commas(path, number, line)
        except RecordingError as error:
            return str(error)
    return ""
