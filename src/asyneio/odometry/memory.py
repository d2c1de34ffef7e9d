# SPDX-License-Identifier: Apache-2.0
"""Memory that the estimator allocates again for every packet."""

from __future__ import annotations

import numpy as np

#: Size of the largest block [bytes] that the C library of Linux (glibc) can be made to keep.
_LARGEST_KEPT = (32 << 20) - (64 << 10)


def keep_freed_memory() -> None:
    """Make the process keep freed blocks of the size that the estimator allocates again and again.

    The C library of Linux returns a large block to the system when it is freed, and the next one costs a page
    fault every 4 kB: a quarter of the time of a linearisation. It keeps blocks up to the size of the largest
    that was ever freed. The block freed here is never written to and therefore takes no memory. On other
    systems this has no effect.
    """
    np.empty(_LARGEST_KEPT, dtype=np.uint8)
