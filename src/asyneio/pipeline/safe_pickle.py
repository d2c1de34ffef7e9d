# SPDX-License-Identifier: Apache-2.0
"""Pickles that construct nothing but numbers, arrays and the estimator's own classes: no code is executed.

A plain `pickle.load` calls whatever function the file names. This one accepts the classes of the packages
that hold the state of a run, and what NumPy needs to construct an array.
"""

from __future__ import annotations

import importlib
import io
import pickle
from typing import Any

from asyneio.errors import RecordingError

#: Packages whose classes a pickle may contain. None of them opens files or starts processes.
_PACKAGES = (
    "asyneio.config",
    "asyneio.types",
    "asyneio.odometry",
    "asyneio.estimation",
    "asyneio.factors",
    "asyneio.frontend",
    "asyneio.geometry",
    "asyneio.inertial",
    "asyneio.initialization",
    "asyneio.trajectory",
    "asyneio.pipeline.frontend_thread",
)
#: What constructs arrays and scalars, in NumPy 1 and 2.
_NUMPY = {
    (f"numpy.{core}.{module}", name)
    for core in ("core", "_core")
    for module, name in (("multiarray", "_reconstruct"), ("multiarray", "scalar"), ("numeric", "_frombuffer"))
} | {("numpy", "ndarray"), ("numpy", "dtype")}
_BUILTINS = {("builtins", "set"), ("builtins", "frozenset"), ("collections", "deque")}


def dump(value: Any) -> bytes:
    """The value as a pickle."""
    return pickle.dumps(value, protocol=5)


def load(data: bytes) -> Any:
    """The value of a pickle.

    Raises:
        RecordingError: the pickle is damaged, or contains something other than numbers, arrays and classes of
            the estimator.
    """
    try:
        return _RestrictedUnpickler(io.BytesIO(data)).load()
    except RecordingError:
        raise
    except Exception as error:
        raise RecordingError(
            f"the state of a run cannot be restored: {type(error).__name__}: {error}; start the run again "
            "without --resume"
        ) from error


class _RestrictedUnpickler(pickle.Unpickler):
    def find_class(self, module: str, name: str) -> Any:
        """A permitted class or constructor. Raises RecordingError: anything else."""
        if (module, name) in _NUMPY | _BUILTINS:
            return super().find_class(module, name)
        if any(module == package or module.startswith(f"{package}.") for package in _PACKAGES):
            found = getattr(importlib.import_module(module), name, None)
            # A module also contains what it imports: only its own classes are permitted.
            if isinstance(found, type) and found.__module__ == module:
                return found
        raise RecordingError(
            f"the state of a run names {module}.{name}; expected numbers, arrays and classes of the "
            "estimator only: the file does not come from asyneio, do not use it"
        )
