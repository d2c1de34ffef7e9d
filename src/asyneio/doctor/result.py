# SPDX-License-Identifier: Apache-2.0
"""Results of the checks, and the report that collects them."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from enum import IntEnum
from typing import Any


class Severity(IntEnum):
    """OK; NOTE: good to know; WARNING: results will suffer; FAIL: not usable as it is."""

    OK = 0
    NOTE = 1
    WARNING = 2
    FAIL = 3


def _plain(value: Any) -> Any:
    """Copy of a value that JSON can represent: numbers that are not finite become None."""
    if isinstance(value, dict):
        return {key: _plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


@dataclass(frozen=True)
class CheckResult:
    """The result of one check.

    Attributes:
        check: name of the check.
        severity: severity of the finding.
        measured: what was found, as text with figures.
        expected: what a good recording has; empty if there is no problem.
        fix: what to do; empty if there is no problem.
        values: the figures as plain values, for programs.
        prevents: commands that need the missing or failed part. A FAIL without any prevents all commands.
    """

    check: str
    severity: Severity
    measured: str
    expected: str = ""
    fix: str = ""
    values: dict[str, Any] = field(default_factory=dict)
    prevents: tuple[str, ...] = ()

    def to_dict(self) -> dict[str, Any]:
        """Plain values for JSON."""
        return {
            "check": self.check,
            "severity": self.severity.name,
            "measured": self.measured,
            "expected": self.expected,
            "fix": self.fix,
            "values": _plain(self.values),
            "prevents": list(self.prevents),
        }


@dataclass(frozen=True)
class Report:
    """All results on a recording, in the order of the checks, and how long the checks took.

    Attributes:
        recording: path of the recording.
        results: one result for each check that applies.
        commands: commands that take recordings of this kind.
        repairs: messages in which a run would report what it repaired or assumed.
        events: number of events read.
        seconds: duration of all checks [s].
        reading_s: the part of it that went into decoding and scanning events [s].
    """

    recording: str
    results: tuple[CheckResult, ...]
    commands: tuple[str, ...] = ("run", "track")
    repairs: tuple[str, ...] = ()
    events: int = 0
    seconds: float = 0.0
    reading_s: float = 0.0

    @property
    def worst(self) -> Severity:
        """The highest severity of all results."""
        return max((result.severity for result in self.results), default=Severity.OK)

    @property
    def usable_for(self) -> tuple[str, ...]:
        """Commands that can use the recording as it is."""
        if any(result.severity is Severity.FAIL and not result.prevents for result in self.results):
            return ()
        prevented = {command for result in self.results for command in result.prevents}
        return tuple(command for command in self.commands if command not in prevented)

    @property
    def headline(self) -> str:
        """One line: usable or not, and the most severe finding."""
        first = max(self.results, key=lambda result: result.severity, default=None)
        if first is not None and first.severity is Severity.FAIL:
            return f"{self._not_usable}; first cause: {first.check}: {first.measured}"
        if not self.usable_for:
            return "neither odometry nor tracking is possible with this recording"
        usable = f"usable for {' and '.join(f'asyneio {command}' for command in self.usable_for)}"
        if first is None or first.severity is not Severity.WARNING:
            return usable
        return f"{usable}; check first: {first.check}: {first.measured}"

    @property
    def _not_usable(self) -> str:
        """Which commands cannot use a recording with a FAIL."""
        if not self.usable_for:
            return "not usable as it is"
        prevented = " and ".join(f"asyneio {name}" for name in self.commands if name not in self.usable_for)
        usable = " and ".join(f"asyneio {name}" for name in self.usable_for)
        return f"not usable as it is for {prevented}, but for {usable}"

    @property
    def summary(self) -> str:
        """One line: what the recording can be used for, and the number of results of each severity."""
        counts = ", ".join(
            f"{sum(v.severity is severity for v in self.results)} {severity.name}"
            for severity in (Severity.FAIL, Severity.WARNING, Severity.NOTE)
        )
        failed = [v.check for v in self.results if v.severity is Severity.FAIL]
        if failed:
            return f"{self._not_usable} ({', '.join(dict.fromkeys(failed))}): {counts}"
        if not self.usable_for:
            return f"neither odometry nor tracking is possible with this recording: {counts}"
        return f"usable for {' and '.join(f'asyneio {command}' for command in self.usable_for)}: {counts}"

    def to_dict(self) -> dict[str, Any]:
        """Plain values for JSON (docs/doctor.md)."""
        return {
            "recording": self.recording,
            "worst": self.worst.name,
            "usable_for": list(self.usable_for),
            "summary": self.summary,
            "headline": self.headline,
            "results": [result.to_dict() for result in self.results],
            "repairs": list(self.repairs),
            "events": self.events,
            "seconds": self.seconds,
            "reading_s": self.reading_s,
        }
