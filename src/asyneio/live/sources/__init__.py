"""Sources of live data: `file:`, `socket:`, `dv:` and `usb:`."""

from asyneio.live.sources.address import open_source
from asyneio.live.sources.rig import RigOptions

__all__ = ["RigOptions", "open_source"]
