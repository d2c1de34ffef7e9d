# SPDX-License-Identifier: Apache-2.0
"""Published results on a data set, each as its source states it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum


class Measure(StrEnum):
    """The figure by which results on a data set are compared."""

    MPE = "mpe_percent"
    ATE = "ate_cm"

    @property
    def heading(self) -> str:
        """Name and unit."""
        return {"mpe_percent": "MPE [%]", "ate_cm": "ATE [cm]"}[self.value]


@dataclass(frozen=True)
class Published:
    """Results of one method.

    Attributes:
        method: name, year, and what it runs on if unusual.
        uses: E events, F frames, I inertial samples; "stereo" if two cameras.
        results: figure by sequence, in the measure of the data set.
        alignment: the name of our protocol, or a description; empty if it is not stated.
        source: where the figures are published.
    """

    method: str
    uses: str
    results: Mapping[str, float] = field(default_factory=dict)
    alignment: str = ""
    source: str = ""


def by_sequence(sequences: Sequence[str], results: Sequence[float]) -> dict[str, float]:
    """Figures in the order of the sequences as a mapping."""
    return dict(zip(sequences, results, strict=True))
