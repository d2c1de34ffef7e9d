"""Is a recording usable, and if not, what is to be done?"""

from asyneio.doctor.examination import examine
from asyneio.doctor.verdict import Diagnosis, Severity, Verdict

__all__ = ["Diagnosis", "Severity", "Verdict", "examine"]
