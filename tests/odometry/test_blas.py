"""The estimator works with one BLAS thread and leaves the process as it was."""

from __future__ import annotations

import pytest
from threadpoolctl import ThreadpoolController, threadpool_limits

from asyneio.config import Config
from asyneio.odometry import Odometry
from asyneio.types import Packet
from tests.odometry.runs import empty, simulated


def blas_threads() -> list[int]:
    return [library["num_threads"] for library in ThreadpoolController().select(user_api="blas").info()]


def test_one_thread_within_and_the_number_before_after(monkeypatch: pytest.MonkeyPatch) -> None:
    within: list[int] = []

    def watched(self: Odometry, packet: Packet) -> str:
        within.extend(blas_threads())
        raise RuntimeError

    monkeypatch.setattr(Odometry, "_append", watched)
    with threadpool_limits(limits=2, user_api="blas"):
        before = blas_threads()
        with pytest.raises(RuntimeError):
            Odometry(Config(), simulated().recording.calibration).process(empty(1))
        assert blas_threads() == before
    assert set(before) == {2}
    assert within
    assert set(within) == {1}
