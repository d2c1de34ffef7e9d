"""What must come of the cases of `benchmarks/cases.py`: one module for each group of kinds."""

from __future__ import annotations

from case_expectations import events, files, sensors
from case_expectations.step import Expectations, Step

#: All cases that have expectations.
EXPECTATIONS: Expectations = {**events.CASES, **files.CASES, **sensors.CASES}

__all__ = ["EXPECTATIONS", "Expectations", "Step"]
