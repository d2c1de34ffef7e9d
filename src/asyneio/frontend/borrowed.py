# SPDX-License-Identifier: Apache-2.0
"""Arrays without reference counts, for the event loops."""

from __future__ import annotations

from typing import Any

from numba.core import cgutils, types
from numba.extending import intrinsic


@intrinsic
def borrowed(_context: Any, values: Any) -> Any:
    """A tuple of arrays, nested or not, whose arrays have no owner.

    Numba counts a reference to every array of a tuple each time the tuple is passed on, which takes several
    times as long as an event. An array without an owner has no references to count. The caller must keep the
    arrays alive: a kernel may borrow its arguments, and must not return them.
    """
    if not isinstance(values, types.BaseTuple):  # type: ignore[attr-defined]
        return None

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        """Emit the members without their owners, for the compiler."""
        return _without_owner(context, builder, signature.return_type, args[0])

    return values(values), codegen


def _without_owner(context: Any, builder: Any, kind: Any, value: Any) -> Any:
    if isinstance(kind, types.BaseTuple):  # type: ignore[attr-defined]
        for i, member in enumerate(kind):
            bare = _without_owner(context, builder, member, builder.extract_value(value, i))
            value = builder.insert_value(value, bare, i)
        return value
    if isinstance(kind, types.Array):
        view = context.make_array(kind)(context, builder, value)
        view.meminfo = cgutils.get_null_value(view.meminfo.type)
        view.parent = cgutils.get_null_value(view.parent.type)
        return view._getvalue()
    return value
