# SPDX-License-Identifier: Apache-2.0
"""One module for each subject of examination: what is wrong with it and how to fix it."""
