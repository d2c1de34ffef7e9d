# SPDX-License-Identifier: Apache-2.0
"""Sources of live data: `file:`, `socket:`, `dv:` and `usb:`."""

from asyneio.live.sources.address import open_source
from asyneio.live.sources.calibration import CalibrationOptions

__all__ = ["CalibrationOptions", "open_source"]
