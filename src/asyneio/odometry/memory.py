"""Memory that the estimator asks for again with every packet."""

from __future__ import annotations

import numpy as np

#: The largest block [bytes] that the C library of Linux (glibc) learns to keep; it may not be larger.
_LARGEST_KEPT = (32 << 20) - (64 << 10)


def keep_freed_memory() -> None:
    """Have blocks of the size that the estimator frees and asks for again kept in the process.

    The C library of Linux gives a large block back to the system when it is freed, and the next one costs a
    page fault every 4 kB: a quarter of the time of a linearisation. It keeps blocks as large as the largest
    that was ever freed. The block freed here is never written to and so never takes memory. Elsewhere this
    does nothing.
    """
    np.empty(_LARGEST_KEPT, dtype=np.uint8)
