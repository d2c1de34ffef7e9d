"""Which topic of a bag is meant."""

from __future__ import annotations

from pathlib import Path

from asyneio.errors import RecordingError
from asyneio.io.ros.bag import Topic
from asyneio.io.ros.survey import Survey

_MAX_LISTED = 20


def choose_topic(
    found: Survey, candidates: list[Topic], wanted: str | None, option: str, path: Path
) -> Topic | None:
    """The topic to take; None where there is none. Raises RecordingError where it cannot be told."""
    filled = [topic for topic in candidates if found.counts[topic]]
    if wanted is not None and filled:
        named = [topic for topic in filled if topic.name == wanted]
        if not named:
            raise RecordingError(
                f"{path} has no {option} in a topic {wanted}; it has {listed_topics(found, filled)}"
            )
        return named[0]
    if len(filled) > 1:
        raise RecordingError(
            f"{path} has {len(filled)} topics of {option}: {listed_topics(found, filled)}; choose one with "
            f"--{option} TOPIC"
        )
    return filled[0] if filled else None


def listed_topics(found: Survey, topics: list[Topic]) -> str:
    """Topics with their types and numbers of messages, for messages."""
    names = [f"{topic.name} ({topic.type}, {found.counts[topic]} messages)" for topic in topics[:_MAX_LISTED]]
    more = f" and {len(topics) - _MAX_LISTED} more" if len(topics) > _MAX_LISTED else ""
    return (", ".join(names) or "no message") + more
