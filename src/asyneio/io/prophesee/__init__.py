# SPDX-License-Identifier: Apache-2.0
"""Raw files of Prophesee cameras: EVT 2, EVT 2.1, EVT 3 and DAT."""
