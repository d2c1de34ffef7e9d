"""What a check has to say."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import IntEnum
from typing import Any


class Severity(IntEnum):
    """How bad it is: OK; NOTE: good to know; WARNING: results suffer; FAIL: not usable as it is."""

    OK = 0
    NOTE = 1
    WARNING = 2
    FAIL = 3


@dataclass(frozen=True)
class Verdict:
    """The outcome of one check.

    Attributes:
        check: its name.
        severity: how bad it is.
        measured: what was found, in words with figures.
        expected: what a good recording has; empty where nothing is amiss.
        cure: what to do; empty where nothing is amiss.
        values: the figures as plain values, for machines.
        prevents_run: something that `asyneio run` needs is missing, though features may be followed.
    """

    check: str
    severity: Severity
    measured: str
    expected: str = ""
    cure: str = ""
    values: dict[str, Any] = field(default_factory=dict)
    prevents_run: bool = False

    def to_dict(self) -> dict[str, Any]:
        """Plain values for JSON."""
        return {
            "check": self.check,
            "severity": self.severity.name,
            "measured": self.measured,
            "expected": self.expected,
            "cure": self.cure,
            "values": self.values,
        }


@dataclass(frozen=True)
class Diagnosis:
    """All verdicts on a recording, in the order of the checks, and how long the examination took.

    `repairs` are the sentences in which a run would tell what it repaired or assumed.
    """

    recording: str
    verdicts: tuple[Verdict, ...]
    repairs: tuple[str, ...] = ()
    events: int = 0
    seconds: float = 0.0
    #: Of these, those that went into decoding and looking at events.
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
        if any(verdict.prevents_run for verdict in self.verdicts):
            return ("track",)
        return ("run",) if self.events == 0 else ("run", "track")

    @property
    def summary(self) -> str:
        """One line: what it can be used for, and how many verdicts are bad."""
        counts = ", ".join(
            f"{sum(v.severity is severity for v in self.verdicts)} {severity.name}"
            for severity in (Severity.FAIL, Severity.WARNING, Severity.NOTE)
        )
        if not self.usable_for:
            failed = [v.check for v in self.verdicts if v.severity is Severity.FAIL]
            return f"not usable as it is ({', '.join(failed)}): {counts}"
        return f"usable for asyneio {' and '.join(self.usable_for)}: {counts}"

    def to_dict(self) -> dict[str, Any]:
        """Plain values for JSON (docs/doctor.md)."""
        return {
            "recording": self.recording,
            "worst": self.worst.name,
            "usable_for": list(self.usable_for),
            "summary": self.summary,
            "verdicts": [verdict.to_dict() for verdict in self.verdicts],
            "repairs": list(self.repairs),
            "events": self.events,
            "seconds": self.seconds,
            "reading_s": self.reading_s,
        }
