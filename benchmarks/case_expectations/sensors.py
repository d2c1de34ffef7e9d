"""Sensors and surroundings: kinds C, D, E (IMU), L and M (arrays)."""

from __future__ import annotations

from case_expectations.step import Expectations, Step

CASES: Expectations = {
    "P01": (
        Step("python data/use.py; echo rc=$?", says=(r"240 x 180", r"rc=1\b"), silent=(r"rc=139",)),
    ),
}
