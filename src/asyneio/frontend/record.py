"""The type of one element of a structured array."""

from __future__ import annotations

from typing import Any, TypeAlias

#: A record: Numba reads and writes its fields as attributes, which numpy's own type does not know.
Record: TypeAlias = Any
