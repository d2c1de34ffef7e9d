"""Comparisons as repeatable studies: conditions times seeds, measured in parallel, told in tables."""

from collections.abc import Callable

from asyneio.studies.expressiveness import expressiveness
from asyneio.studies.preintegration import preintegration
from asyneio.studies.runner import StudyResult, run_study
from asyneio.studies.schemes import schemes
from asyneio.studies.study import Study

#: Studies by name; each takes `quick` and the number of seeds (None: its own).
STUDIES: dict[str, Callable[[bool, int | None], Study]] = {
    study.__name__: study for study in (expressiveness, preintegration, schemes)
}

__all__ = ["STUDIES", "Study", "StudyResult", "run_study"]
