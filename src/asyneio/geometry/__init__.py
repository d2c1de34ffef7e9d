"""Lie-group kernels and camera models. Kernels take arrays and scalars, write into `out` and never raise."""
