# SPDX-License-Identifier: Apache-2.0
"""Small dense products for kernels: at these sizes a loop beats a BLAS call several times."""

from __future__ import annotations

from asyneio.jit import njit
from asyneio.types import FloatArray


@njit(cache=True, nogil=True)
def cross(a: FloatArray, b: FloatArray, out: FloatArray) -> None:
    """`out = a x b`, all (3,); `out` must not be an input."""
    out[0] = a[1] * b[2] - a[2] * b[1]
    out[1] = a[2] * b[0] - a[0] * b[2]
    out[2] = a[0] * b[1] - a[1] * b[0]


@njit(cache=True, nogil=True)
def skew(a: FloatArray, out: FloatArray) -> None:
    """`out = a^`, (3,3), so that `a^ b = a x b`."""
    out[0, 0] = 0.0
    out[0, 1] = -a[2]
    out[0, 2] = a[1]
    out[1, 0] = a[2]
    out[1, 1] = 0.0
    out[1, 2] = -a[0]
    out[2, 0] = -a[1]
    out[2, 1] = a[0]
    out[2, 2] = 0.0


@njit(cache=True, nogil=True)
def matmul(A: FloatArray, B: FloatArray, out: FloatArray) -> None:
    """`out = A B` for small matrices of any matching shape; `out` must not be an input."""
    for i in range(A.shape[0]):
        for j in range(B.shape[1]):
            s = 0.0
            for k in range(A.shape[1]):
                s += A[i, k] * B[k, j]
            out[i, j] = s


@njit(cache=True, nogil=True)
def matmul_tn(A: FloatArray, B: FloatArray, out: FloatArray) -> None:
    """`out = A^T B`; `out` must not be an input."""
    for i in range(A.shape[1]):
        for j in range(B.shape[1]):
            s = 0.0
            for k in range(A.shape[0]):
                s += A[k, i] * B[k, j]
            out[i, j] = s


@njit(cache=True, nogil=True)
def matvec(A: FloatArray, x: FloatArray, out: FloatArray) -> None:
    """`out = A x`; `out` must not be an input."""
    for i in range(A.shape[0]):
        s = 0.0
        for k in range(A.shape[1]):
            s += A[i, k] * x[k]
        out[i] = s


@njit(cache=True, nogil=True)
def matvec_t(A: FloatArray, x: FloatArray, out: FloatArray) -> None:
    """`out = A^T x`; `out` must not be an input."""
    for i in range(A.shape[1]):
        s = 0.0
        for k in range(A.shape[0]):
            s += A[k, i] * x[k]
        out[i] = s


@njit(cache=True, nogil=True, literals=False)
def set_block(out: FloatArray, row: int, column: int, s: float, A: FloatArray) -> None:
    """`out[row:, column:] = s A`, of the size of `A`; a sliced assignment would compile checks of shapes and
    their messages as well."""
    for i in range(A.shape[0]):
        for j in range(A.shape[1]):
            out[row + i, column + j] = s * A[i, j]


@njit(cache=True, nogil=True, literals=False)
def add_block(out: FloatArray, row: int, column: int, s: float, A: FloatArray) -> None:
    """`out[row:, column:] += s A`, of the size of `A`."""
    for i in range(A.shape[0]):
        for j in range(A.shape[1]):
            out[row + i, column + j] += s * A[i, j]
