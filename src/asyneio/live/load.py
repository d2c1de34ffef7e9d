"""How much of a processor core the front end may use, by what the clock on the wall shows."""

from __future__ import annotations

#: The limit sets in where data wait longer than this share of the longest backlog, and goes where they wait
#: less than the second share.
_HIGH, _LOW = 0.5, 0.15
#: The first limit, and factors on it: each packet while data wait too long, each packet while they do not.
_FIRST, _LESS, _MORE = 1.0, 0.8, 1.05
#: Below the first there would be no odometry; above the second the limit is no longer needed.
_LEAST, _ENOUGH = 0.05, 2.0


class LoadControl:
    """Sets `Frontend.limit_load` packet by packet.

    While nothing waits the configured limit holds, so that results are those of a recording.

    Args:
        configured: `frontend.max_load`; 0: no limit.
        max_backlog_s: the longest time that data should wait.
    """

    def __init__(self, configured: float, max_backlog_s: float) -> None:
        self._configured = configured
        self._max_backlog_s = max_backlog_s
        self.share = configured

    @property
    def limited(self) -> bool:
        """A limit beyond the configured one is set."""
        return self.share != self._configured

    def update(self, backlog_s: float) -> float:
        """The limit for the next packet, from how long data have been waiting [s]."""
        if backlog_s > _HIGH * self._max_backlog_s:
            least = _LEAST if not self._configured else min(_LEAST, self._configured)
            self.share = max(_LESS * (self.share or _FIRST / _LESS), least)
        elif self.limited and backlog_s < _LOW * self._max_backlog_s:
            raised = _MORE * self.share
            self.share = self._configured if raised >= (self._configured or _ENOUGH) else raised
        return self.share
