# SPDX-License-Identifier: Apache-2.0
"""One BLAS thread while the estimator works, whatever calls it."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache, wraps
from typing import ParamSpec, TypeVar

# The libraries must be loaded before threadpoolctl looks for them.
import numpy as np  # noqa: F401
import scipy.linalg  # noqa: F401
from threadpoolctl import ThreadpoolController

_P = ParamSpec("_P")
_R = TypeVar("_R")


def with_one_blas_thread(function: Callable[_P, _R]) -> Callable[_P, _R]:
    """Decorator: the BLAS libraries of the process use one thread during a call, and as many as before after
    it.

    The matrices of the window are small. More threads gain little on an idle machine, wait for their share of
    a busy one, and spin while they wait: from Python, 20 s of data cost 128 s of CPU time instead of 35.
    """

    @wraps(function)
    def limited(*args: _P.args, **kwargs: _P.kwargs) -> _R:
        """The function, with one BLAS thread while it runs."""
        with _libraries().limit(limits=1):
            return function(*args, **kwargs)

    return limited


@cache
def _libraries() -> ThreadpoolController:
    return ThreadpoolController().select(user_api="blas")
