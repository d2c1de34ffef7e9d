"""The type of one element of a structured array."""

from __future__ import annotations

from typing import Any, NamedTuple, TypeAlias, get_type_hints

import numpy as np

from asyneio.types import RecordArray

#: A record: Numba reads and writes its fields as attributes, which numpy's own type does not know.
Record: TypeAlias = Any

#: Options of a kernel that only kernels call: what Python would call it through is not compiled.
INNER: dict[str, Any] = {"cache": True, "no_cpython_wrapper": True, "no_cfunc_wrapper": True}


def record_of(values: NamedTuple) -> RecordArray:
    """Numbers under their names as an array (1,) of a record.

    Kernels pass a record on as one pointer, where a tuple of many numbers is taken apart at every call: that
    takes time to compile.
    """
    kinds = {int: "<i8", float: "<f8"}
    fields = [(name, kinds[kind]) for name, kind in get_type_hints(type(values)).items()]
    return np.array([tuple(values)], dtype=np.dtype(fields, align=True))
