# SPDX-License-Identifier: Apache-2.0
"""Repeatable studies: conditions times seeds, measured in parallel, reported as tables and figures."""
