# SPDX-License-Identifier: Apache-2.0
"""Health of the estimator: metrics of every knot, a state machine, and detection of scene changes."""
