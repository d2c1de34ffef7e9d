# SPDX-License-Identifier: Apache-2.0
"""Tools that know no recording: text tables, safe HDF5 and zip access, timestamps, atomic writing."""
