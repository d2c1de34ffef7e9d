# SPDX-License-Identifier: Apache-2.0
"""Pickles that construct nothing but numbers, arrays and the estimator's own classes: no code is executed.

A plain `pickle.load` calls whatever function the file names. This one accepts the classes of the packages
that hold the state of a run, and what NumPy needs to construct an array.

Arrays that share memory still share it afterwards, with the same strides: a plain pickle copies every view,
and what is written to one of two views then no longer appears in the other.
"""

from __future__ import annotations

import importlib
import io
import pickle
from typing import Any

import numpy as np

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
    "asyneio.pipeline.delayed",
    "asyneio.pipeline.frontend_thread",
    "asyneio.pipeline.track_source",
)
#: What constructs arrays and scalars, in NumPy 1 and 2.
_NUMPY = {
    (f"numpy.{core}.{module}", name)
    for core in ("core", "_core")
    for module, name in (("multiarray", "_reconstruct"), ("multiarray", "scalar"), ("numeric", "_frombuffer"))
} | {("numpy", "ndarray"), ("numpy", "dtype")}
_PERMITTED = _NUMPY | {
    ("builtins", "set"),
    ("builtins", "frozenset"),
    ("collections", "deque"),
    (__name__, "view_of"),
    # The preintegration rules of the schemes: functions of numbers.
    ("asyneio.inertial.gp_preintegration", "gp_preintegration"),
    ("asyneio.inertial.preintegration", "midpoint"),
}
#: A view of an array that is larger by more than this is stored as a copy [bytes]: it is a slice of the
#: recording, which is not written to.
_MOST_UNSEEN_BYTES = 4 * 2**20


def dump(value: Any) -> bytes:
    """The value as a pickle."""
    stream = io.BytesIO()
    _ViewPickler(stream, protocol=5).dump(value)
    return stream.getvalue()


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


def view_of(
    owner: np.ndarray, offset: int, shape: tuple[int, ...], dtype: np.dtype[Any], strides: tuple[int, ...]
) -> np.ndarray:
    """An array inside the memory of another one, which is contiguous; NumPy checks that it fits."""
    memory = owner if owner.flags.c_contiguous else owner.T
    return np.ndarray(shape, dtype, memory, offset, strides)


class _ViewPickler(pickle.Pickler):
    def reducer_override(self, value: Any) -> Any:
        """Store a view as its place in the array that owns the memory, which is stored once."""
        if type(value) is not np.ndarray or type(value.base) is not np.ndarray or value.size == 0:
            return NotImplemented
        owner = value.base
        if not owner.flags.forc or owner.nbytes > value.nbytes + _MOST_UNSEEN_BYTES or owner.dtype.hasobject:
            return NotImplemented
        offset = value.__array_interface__["data"][0] - owner.__array_interface__["data"][0]
        return view_of, (owner, offset, value.shape, value.dtype, value.strides)


class _RestrictedUnpickler(pickle.Unpickler):
    def find_class(self, module: str, name: str) -> Any:
        """A permitted class or constructor. Raises RecordingError: anything else."""
        if (module, name) in _PERMITTED:
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
