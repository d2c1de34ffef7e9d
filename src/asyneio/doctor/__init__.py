"""Is a recording usable, and if not, what is to be done?"""

from asyneio.doctor.examination import examine
from asyneio.doctor.result import CheckResult, Diagnosis, Severity

__all__ = ["CheckResult", "Diagnosis", "Severity", "examine"]
