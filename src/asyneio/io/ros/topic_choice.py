# SPDX-License-Identifier: Apache-2.0
"""Selection of a topic of a bag."""

from __future__ import annotations

from pathlib import Path

from asyneio.errors import RecordingError
from asyneio.io.ros.bag import Topic
from asyneio.io.ros.survey import Survey

_MAX_LISTED = 20


def choose_topic(
    found: Survey, candidates: list[Topic], selected: str | None, option: str, path: Path
) -> Topic | None:
    """The topic to use; None if there is none. Raises RecordingError: unknown or ambiguous topic."""
    filled = [topic for topic in candidates if found.counts[topic]]
    if selected is not None and filled:
        named = [topic for topic in filled if topic.name == selected]
        if not named:
            raise RecordingError(
                f"{path} has no {option} in a topic {selected}; available: {listed_topics(found, filled)}"
            )
        return named[0]
    if len(filled) > 1:
        raise RecordingError(
            f"{path} has {len(filled)} topics of {option}: {listed_topics(found, filled)}; select one with "
            f"--{option} TOPIC"
        )
    return filled[0] if filled else None


def listed_topics(found: Survey, topics: list[Topic]) -> str:
    """Topics with types and numbers of messages, for error messages."""
    names = [f"{topic.name} ({topic.type}, {found.counts[topic]} messages)" for topic in topics[:_MAX_LISTED]]
    more = f" and {len(topics) - _MAX_LISTED} more" if len(topics) > _MAX_LISTED else ""
    return (", ".join(names) or "no messages") + more
