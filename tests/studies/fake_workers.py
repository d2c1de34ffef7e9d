"""Preloaded by the workers of a cluster in tests: an estimator that takes half a second per recording.

Use: `dask worker --preload tests.studies.fake_workers`. Nothing is compiled.
"""

from __future__ import annotations

import time
from typing import Any

from asyneio.pipeline import compilation
from asyneio.pipeline import run as pipeline
from tests.cli.fakes import FakeOdometry


class SlowOdometry(FakeOdometry):
    """The fake estimator, which takes its time at the beginning."""

    def __init__(self, *arguments: Any, **more: Any) -> None:
        super().__init__(*arguments, **more)
        time.sleep(0.5)


def dask_setup(worker: Any) -> None:
    """Called by Dask in the worker."""
    pipeline.Odometry = SlowOdometry  # type: ignore[assignment,misc,attr-defined]
    compilation.are_compiled = lambda: True
