# SPDX-License-Identifier: Apache-2.0
"""Continuous-time trajectory: a motion prior on local variables around the last knot (7)-(20)."""
