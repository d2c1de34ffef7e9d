# SPDX-License-Identifier: Apache-2.0
"""Studies by name."""

from __future__ import annotations

from collections.abc import Callable

from asyneio.studies.expressiveness import expressiveness
from asyneio.studies.preintegration import preintegration
from asyneio.studies.schemes import schemes
from asyneio.studies.study import Study

#: Each takes `quick` and the number of seeds (None: the study's default).
STUDIES: dict[str, Callable[[bool, int | None], Study]] = {
    study.__name__: study for study in (expressiveness, preintegration, schemes)
}
