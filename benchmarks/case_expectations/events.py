"""Event files and folders: kinds A, B, E (events), M (files) and N."""

from __future__ import annotations

from case_expectations.step import Expectations, Step

CASES: Expectations = {
    "E07b": (
        Step("asyneio doctor data", says=(r"\d{5} events", r"0 FAIL"), silent=(r"unreadable", r"skipped")),
    ),
}
