"""What a check has to say."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from enum import IntEnum
from typing import Any


class Severity(IntEnum):
    """How bad it is: OK; NOTE: good to know; WARNING: results suffer; FAIL: not usable as it is."""

    OK = 0
    NOTE = 1
    WARNING = 2
    FAIL = 3


def _plain(value: Any) -> Any:
    """As JSON can hold it: figures that are not finite become None."""
    if isinstance(value, dict):
        return {key: _plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


@dataclass(frozen=True)
class CheckResult:
    """The outcome of one check.

    Attributes:
        check: its name.
        severity: how bad it is.
        measured: what was found, in words with figures.
        expected: what a good recording has; empty where nothing is amiss.
        cure: what to do; empty where nothing is amiss.
        values: the figures as plain values, for machines.
        prevents: commands that need what is missing, although nothing is wrong with what is there.
    """

    check: str
    severity: Severity
    measured: str
    expected: str = ""
    cure: str = ""
    values: dict[str, Any] = field(default_factory=dict)
    prevents: tuple[str, ...] = ()

    def to_dict(self) -> dict[str, Any]:
        """Plain values for JSON."""
        return {
            "check": self.check,
            "severity": self.severity.name,
            "measured": self.measured,
            "expected": self.expected,
            "cure": self.cure,
            "values": _plain(self.values),
            "prevents": list(self.prevents),
        }


@dataclass(frozen=True)
class Diagnosis:
    """All verdicts on a recording, in the order of the checks, and how long the examination took.

    `commands` take recordings of this kind. `repairs` are the sentences in which a run would tell what it
    repaired or assumed. Of the `seconds`, `reading_s` went into decoding and looking at events.
    """

    recording: str
    verdicts: tuple[CheckResult, ...]
    commands: tuple[str, ...] = ("run", "track")
    repairs: tuple[str, ...] = ()
    events: int = 0
    seconds: float = 0.0
    reading_s: float = 0.0

    @property
    def worst(self) -> Severity:
        """The severity of the worst verdict."""
        return max((verdict.severity for verdict in self.verdicts), default=Severity.OK)

    @property
    def usable_for(self) -> tuple[str, ...]:
        """The commands that can use the recording as it is."""
        if self.worst is Severity.FAIL:
            return ()
        prevented = {command for verdict in self.verdicts for command in verdict.prevents}
        return tuple(command for command in self.commands if command not in prevented)

    @property
    def headline(self) -> str:
        """One line: usable or not, and the first cause."""
        first = max(self.verdicts, key=lambda verdict: verdict.severity, default=None)
        if first is not None and first.severity is Severity.FAIL:
            return f"not usable as it is; first cause: {first.check}: {first.measured}"
        if not self.usable_for:
            return "neither odometry nor tracking is possible with what is there"
        usable = f"usable for {' and '.join(f'asyneio {command}' for command in self.usable_for)}"
        if first is None or first.severity is not Severity.WARNING:
            return usable
        return f"{usable}; first to look at: {first.check}: {first.measured}"

    @property
    def summary(self) -> str:
        """One line: what it can be used for, and how many verdicts are bad."""
        counts = ", ".join(
            f"{sum(v.severity is severity for v in self.verdicts)} {severity.name}"
            for severity in (Severity.FAIL, Severity.WARNING, Severity.NOTE)
        )
        failed = [v.check for v in self.verdicts if v.severity is Severity.FAIL]
        if failed:
            return f"not usable as it is ({', '.join(dict.fromkeys(failed))}): {counts}"
        if not self.usable_for:
            return f"neither odometry nor tracking is possible with what is there: {counts}"
        return f"usable for {' and '.join(f'asyneio {command}' for command in self.usable_for)}: {counts}"

    def to_dict(self) -> dict[str, Any]:
        """Plain values for JSON (docs/doctor.md)."""
        return {
            "recording": self.recording,
            "worst": self.worst.name,
            "usable_for": list(self.usable_for),
            "summary": self.summary,
            "headline": self.headline,
            "verdicts": [verdict.to_dict() for verdict in self.verdicts],
            "repairs": list(self.repairs),
            "events": self.events,
            "seconds": self.seconds,
            "reading_s": self.reading_s,
        }
