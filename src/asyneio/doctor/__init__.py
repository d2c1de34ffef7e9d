# SPDX-License-Identifier: Apache-2.0
"""Check whether a recording is usable, and report how to fix it if it is not."""

from asyneio.doctor.examination import examine
from asyneio.doctor.result import CheckResult, Report, Severity

__all__ = ["CheckResult", "Report", "Severity", "examine"]
