# SPDX-License-Identifier: Apache-2.0
"""Folders and zip files in the layout of the UZH event camera data set."""
