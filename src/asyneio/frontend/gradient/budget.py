"""What the front end may spend: tests for corners always, computing time where a limit is set.

Both budgets are kept by the events' own time and by nominal costs, not by a clock on the wall: the same
events are treated alike on every machine, at every speed, however they are cut into packets.
"""

from __future__ import annotations

import numba as nb
import numpy as np

from asyneio.frontend.feature_grid import Tables
from asyneio.frontend.gradient.features import FREE
from asyneio.frontend.gradient.track_management import release
from asyneio.frontend.record import INNER, Record
from asyneio.types import RecordArray

#: Tests for corners: so many in a second of event time, and so many at once after quiet times. A test that
#: says yes founds a feature, and features are founded some hundred times a second.
TESTS_PER_S = 200_000.0
MOST_TESTS = 20_000.0

#: Nominal costs [ns]: of an event, of every feature that it is fed to (updates included), of an event shed.
#: Rounded from a fit on a busy machine; that of an event shed is a guess.
EVENT_NS, FED_NS, SHED_NS = 25.0, 100.0, 5.0
#: Computing time that may be saved up, and owed before features are given up, as seconds of event time.
_SAVED_NS = 20e6
_SLOT_NS = 1_000_000
#: Under load, one of so many events near features is kept.
THINNING = 4
#: Share of the features that are kept when too much computing time is owed, and how many come back a look.
_KEPT, _REGAINED = 0.75, 0.1
#: With fewer there is no odometry.
_FEWEST = 8


@nb.njit(**INNER)
def grant_tests(state: Record, elapsed_ns: int) -> None:
    """Allow the tests for corners of so much event time."""
    state.tests = min(MOST_TESTS, state.tests + elapsed_ns * 1e-9 * TESTS_PER_S)


@nb.njit(**INNER)
def has_credit(state: Record, t_ns: int) -> bool:
    """Whether an event at that time may be handled whole, under a limit on the load."""
    elapsed_ns = t_ns - state.credited_ns
    if elapsed_ns > _SLOT_NS:
        state.credit_ns = min(state.load * _SAVED_NS, state.credit_ns + state.load * elapsed_ns)
        state.credited_ns = t_ns
    return state.credit_ns > 0.0


@nb.njit(**INNER)
def is_shed(state: Record, features_near: int) -> bool:
    """Whether an event is shed for which there is no credit: where no feature is near it always is, else all
    but one of THINNING are."""
    if features_near == 0:
        state.shed_events += 1
        state.credit_ns -= SHED_NS
        return True
    state.shed_fed += 1
    if state.shed_fed % THINNING:
        state.credit_ns -= SHED_NS
        return True
    return False


@nb.njit(**INNER)
def shed_features(records: RecordArray, tables: Tables, state: Record) -> None:
    """Give up the youngest features while too much computing time is owed; let them come back one by one."""
    owed = state.load * _SAVED_NS
    if state.credit_ns > 0.5 * owed:
        state.allowed += _REGAINED
    if state.credit_ns > -owed:
        return
    state.credit_ns = 0.0
    state.allowed = max(np.floor(_KEPT * state.alive), _FEWEST)
    while state.alive > state.allowed:
        youngest = int(np.int64(-1))
        for slot in range(records.size):
            if records[slot].state != FREE and (
                youngest < 0 or records[slot].born_ns > records[youngest].born_ns
            ):
                youngest = slot
        release(records[youngest], tables, youngest, state)
        state.shed_features += 1
