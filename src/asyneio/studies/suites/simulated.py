# SPDX-License-Identifier: Apache-2.0
"""Simulated recordings, which need no data set: scenarios of `asyneio simulate`."""

from __future__ import annotations

from asyneio.simulation.events.scenario import SUITE
from asyneio.studies.suites.data_set import DataSet
from asyneio.studies.suites.published import Measure

SIMULATED = DataSet(
    name="simulated",
    title="Simulated sequences",
    sequences=tuple(scenario.name for scenario in SUITE),
    locations=(),
    protocols=("posyaw", "evslam"),
    measure=Measure.MPE,
    remark="Evidence: simulation. Any scenario of `asyneio simulate` can be named with --sequences; "
    "those of feature "
    "tracks (moderate, aggressive, ...) need no front end and take seconds. Scenarios with another seed have "
    "another motion.",
)
