# SPDX-License-Identifier: Apache-2.0
"""Decorator of numerical kernels: Numba's `njit`, with half its compilation time where that was tested.

`kernel_forms` says what is saved. It replaces parts of Numba that are not its public interface, so it is used
only with versions of Numba that it was tested with. With others, kernels are compiled as Numba does, with the
same results.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numba
from numba.core import config

#: Versions of Numba with which `kernel_forms` was tested (major, minor).
TESTED = ((0, 68),)


def njit(
    *, cache: bool = False, literals: bool = True, **options: Any
) -> Callable[[Callable[..., Any]], Any]:
    """Compile a function as a kernel.

    Args:
        cache: keep the compiled kernel on disk.
        literals: compile separately for each constant integer that another kernel passes, as Numba does. It
            makes large kernels faster; small ones are copied into their callers and need no such forms.
        options: options of `numba.njit`.
    """

    def decorate(function: Callable[..., Any]) -> Any:
        """The kernel; the function itself without compilation."""
        if config.DISABLE_JIT:
            return function
        if numba.version_info[:2] not in TESTED:
            return numba.njit(cache=cache, **options)(function)
        # Numba's internals are imported only in versions that are known to have them.
        from asyneio.kernel_forms import Kernel

        kernel = Kernel(function, targetoptions={"nopython": True, "boundscheck": None, **options})
        kernel.literals = literals
        if cache:
            kernel.enable_caching()
        return kernel

    return decorate
