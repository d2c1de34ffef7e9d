# SPDX-License-Identifier: Apache-2.0
"""Lie-group kernels and camera models. Kernels take arrays and scalars, write into `out` and never raise."""
