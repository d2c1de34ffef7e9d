# SPDX-License-Identifier: Apache-2.0
"""AEDAT 2 (jAER) and AEDAT 4 (DV)."""
