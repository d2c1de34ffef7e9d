# SPDX-License-Identifier: Apache-2.0
"""Suites of `asyneio bench`: data sets as presets, and the measurement of their recordings."""
