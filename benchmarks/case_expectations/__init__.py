"""Expected results of the cases of `benchmarks/cases.py`: one module for each group of kinds."""

from __future__ import annotations

from case_expectations import events, files, sensors
from case_expectations.step import Expectations, Step

_GROUPS = (events.CASES, files.CASES, sensors.CASES)
#: All cases that have expectations.
EXPECTATIONS: Expectations = {name: steps for group in _GROUPS for name, steps in group.items()}

if len(EXPECTATIONS) != sum(map(len, _GROUPS)):
    raise ValueError("a case has expectations in two modules; leave those of its kind")

__all__ = ["EXPECTATIONS", "Expectations", "Step"]
