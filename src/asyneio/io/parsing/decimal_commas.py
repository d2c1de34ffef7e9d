# SPDX-License-Identifier: Apache-2.0
"""Detection of decimal commas between semicolons, with the command that fixes the file."""

from __future__ import annotations

import re
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
        name = Path(str(path)).name
        raise RecordingError(
            f"{path}: line {number} has decimal commas between semicolons: {line.strip()[:80]!r}; expected "
            f"decimal points. Type: sed -i 's/,/./g; s/;/ /g' {name}"
        )
