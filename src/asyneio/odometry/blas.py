"""One BLAS thread while the estimator works, whoever calls it."""

from __future__ import annotations

from contextlib import AbstractContextManager
from functools import cache

# The libraries must be loaded before they are looked for.
import numpy as np  # noqa: F401
import scipy.linalg  # noqa: F401
from threadpoolctl import ThreadpoolController


def one_blas_thread() -> AbstractContextManager[object]:
    """Within it, the BLAS libraries of the process use one thread; the number before comes back after it.

    The window's matrices are small. More threads gain little on an idle machine, wait for their share of a
    busy one, and spin while they wait: from Python, 20 s of data cost 128 s of CPU time instead of 35.
    """
    return _libraries().limit(limits=1)


@cache
def _libraries() -> ThreadpoolController:
    return ThreadpoolController().select(user_api="blas")
