# SPDX-License-Identifier: Apache-2.0
"""Budgets of the front end: corner tests always, computing time where `frontend.max_load` limits it.

Both budgets run on the time of the events and on nominal costs, not on a wall clock: the result is the same
on every machine, at every playback speed, and for every division of the stream into packets.
"""

from __future__ import annotations

import numpy as np

from asyneio.frontend.gradient.state import GradientArrays
from asyneio.frontend.gradient.track_management import release
from asyneio.frontend.tracker import FREE, INLINE, Record
from asyneio.jit import njit

#: Corner tests per second of event time, and how many may accumulate. For comparison, features begin a few
#: hundred times per second.
TESTS_PER_S = 200_000.0
MOST_TESTS = 20_000.0

#: Nominal costs [ns]: of an event; of each feature that it is fed to, updates included; of a dropped event.
#: The first two are rounded from a fit on a busy machine, the third is estimated.
EVENT_NS, FED_NS, SHED_NS = 25.0, 100.0, 5.0
#: Event time whose credit may accumulate, and may be overdrawn before features are released.
_SAVED_NS = 20e6
#: Credit is added once per this much event time.
_SLOT_NS = 1_000_000
#: Without credit, one in THINNING events near features is processed.
THINNING = 4
#: Share of the features that remain after a release, and how many may begin again per track management.
_KEPT, _REGAINED = 0.75, 0.1
#: Fewest features that remain; odometry needs that many.
_FEWEST = 8


@njit(**INLINE)
def grant_tests(state: Record, elapsed_ns: int) -> None:
    """Add the corner tests of this much event time."""
    state.tests = min(MOST_TESTS, state.tests + elapsed_ns * 1e-9 * TESTS_PER_S)


@njit(**INLINE)
def has_credit(state: Record, t_ns: int) -> bool:
    """Whether an event at `t_ns` may be processed in full."""
    elapsed_ns = t_ns - state.credited_ns
    if elapsed_ns > _SLOT_NS:
        state.credit_ns = min(state.load * _SAVED_NS, state.credit_ns + state.load * elapsed_ns)
        state.credited_ns = t_ns
    return state.credit_ns > 0.0


@njit(cache=True)
def is_shed(state: Record, t_ns: int, features_near: int) -> bool:
    """Under a limit on the load: charge an event, and decide whether it is dropped.

    Without credit, events without a feature nearby are all dropped; of those near features, one in THINNING
    is processed.
    """
    if not has_credit(state, t_ns):
        if features_near == 0:
            state.shed_events += 1
            state.credit_ns -= SHED_NS
            return True
        state.shed_fed += 1
        if state.shed_fed % THINNING:
            state.credit_ns -= SHED_NS
            return True
    state.credit_ns -= EVENT_NS
    return False


@njit(**INLINE)
def shed_features(tracker: GradientArrays) -> None:
    """Release the youngest features if too much credit is overdrawn; otherwise let the number recover."""
    records, state = tracker.features.records, tracker.state[0]
    overdraft = state.load * _SAVED_NS
    if state.credit_ns > 0.5 * overdraft:
        state.allowed += _REGAINED
    if state.credit_ns > -overdraft:
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
        release(records[youngest], tracker.grids, youngest, state)
        state.shed_features += 1
