# SPDX-License-Identifier: Apache-2.0
"""asyneio: asynchronous event-inertial odometry with Gaussian-process regression.

The names below are loaded on first use, so that `import asyneio` takes milliseconds. The library logs to the
logger `asyneio`.
"""

from __future__ import annotations

import importlib
import logging
from typing import TYPE_CHECKING, Any

from asyneio.version import __version__

if TYPE_CHECKING:
    from asyneio.api import evaluate, run, simulate
    from asyneio.config import Config
    from asyneio.frontend import Frontend
    from asyneio.io import open_recording
    from asyneio.odometry import Odometry
    from asyneio.pipeline.report import write_report
    from asyneio.types import Calibration, Estimate, EventRecording, Packet, Recording

__all__ = [
    "Calibration",
    "Config",
    "Estimate",
    "EventRecording",
    "Frontend",
    "Odometry",
    "Packet",
    "Recording",
    "__version__",
    "evaluate",
    "open_recording",
    "run",
    "simulate",
    "write_report",
]

#: The module of each name.
_MODULES = {
    "Calibration": "asyneio.types",
    "Config": "asyneio.config",
    "Estimate": "asyneio.types",
    "EventRecording": "asyneio.types",
    "Frontend": "asyneio.frontend",
    "Odometry": "asyneio.odometry",
    "Packet": "asyneio.types",
    "Recording": "asyneio.types",
    "evaluate": "asyneio.api",
    "open_recording": "asyneio.io",
    "run": "asyneio.api",
    "simulate": "asyneio.api",
    "write_report": "asyneio.pipeline.report",
}

logging.getLogger("asyneio").addHandler(logging.NullHandler())


def __getattr__(name: str) -> Any:
    if name not in _MODULES:
        raise AttributeError(f"module 'asyneio' has no attribute {name!r}")
    value = getattr(importlib.import_module(_MODULES[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
