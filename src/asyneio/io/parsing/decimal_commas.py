"""What a refused line of text seems to hold, and what to type so that it is read."""

from __future__ import annotations

import re
from pathlib import Path

from asyneio.errors import RecordingError

_DECIMAL_COMMA = re.compile(r"(^|[;\s])[+-]?\d+,\d+\s*(;|\s|$)")


def reject_decimal_commas(path: object, number: int, line: str) -> None:
    """Refuse a line whose numbers have decimal commas, quoting it.

    Args:
        path: the file, for the message.
        number: of the line.
        line: as it stands.

    Raises:
        RecordingError: it has semicolons between its numbers and commas in them.
    """
    if ";" in line and _DECIMAL_COMMA.search(line):
        name = Path(str(path)).name
        raise RecordingError(
            f"{path}: line {number} has decimal commas, between semicolons: {line.strip()[:80]!r}; expected "
            f"decimal points. Type: sed -i 's/,/./g; s/;/ /g' {name}"
        )
