# SPDX-License-Identifier: Apache-2.0
"""The baseline tracker HASTE: each event votes for one of a few hypotheses of a feature's motion."""
