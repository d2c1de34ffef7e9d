# SPDX-License-Identifier: Apache-2.0
"""HDF5 files: asyneio's own layout and those of public data sets."""
