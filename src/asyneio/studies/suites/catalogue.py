# SPDX-License-Identifier: Apache-2.0
"""Suites by name."""

from __future__ import annotations

from asyneio.studies.suites.data_set import DataSet
from asyneio.studies.suites.dsec import DSEC
from asyneio.studies.suites.evslam import EVSLAM
from asyneio.studies.suites.mvsec import MVSEC
from asyneio.studies.suites.simulated import SIMULATED
from asyneio.studies.suites.tum_vie import TUM_VIE
from asyneio.studies.suites.uzh import UZH
from asyneio.studies.suites.vector import VECTOR

SUITES: dict[str, DataSet] = {
    suite.name: suite for suite in (UZH, TUM_VIE, VECTOR, MVSEC, DSEC, EVSLAM, SIMULATED)
}
