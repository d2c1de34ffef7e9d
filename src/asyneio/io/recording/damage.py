# SPDX-License-Identifier: Apache-2.0
"""Notes that report a truncated or damaged file, and the strict mode that stops at them."""

from __future__ import annotations

import re
from collections.abc import Sequence

from asyneio.errors import RecordingError

#: How the readers' notes name damage; also found in notes that come from the cache.
_DAMAGE = re.compile(
    r"truncated\?|is damaged or truncated|damaged record\(s\)|is the file damaged\?|is damaged \(|"
    r"unreadable line\(s\)"
)


def damage_notes(notes: Sequence[str]) -> tuple[str, ...]:
    """Those of a recording's notes that report a truncated or damaged file."""
    return tuple(note for note in notes if _DAMAGE.search(note))


def reject_damage(name: str, notes: Sequence[str]) -> None:
    """Raises RecordingError if a note reports a truncated or damaged file."""
    found = damage_notes(notes)
    if found:
        more = f" (and {len(found) - 1} more)" if len(found) > 1 else ""
        raise RecordingError(
            f"{name} is rejected (strict): {found[0]}{more}; repair the file, or read without strict what "
            "precedes the damage"
        )
