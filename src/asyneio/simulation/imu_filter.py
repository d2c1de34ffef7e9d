# SPDX-License-Identifier: Apache-2.0
"""Low-pass filter and delay of an inertial sensor, applied between the motion and the samples.

Motion and vibration are evaluated on a grid of at least 4 kHz, white noise with the given density is added,
and the sum passes a Butterworth filter. Data sheets give a delay as well as a bandwidth: the part of the
delay that is not due to the filter is a pure delay (sampling and decimation) and is applied to the motion
exactly.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.signal import butter, sosfilt, sosfilt_zi

from asyneio.errors import SimulationError
from asyneio.simulation.imu_errors import StreamErrors
from asyneio.types import FloatArray

Signal = Callable[[FloatArray], FloatArray]

#: Minimum rate of the grid of the filter, which is a multiple of the sampling rate [Hz].
_GRID_HZ = 4000.0
#: Samples of the grid processed at a time; bounds the memory.
_BLOCK = 1 << 16
#: Settling time before the first sample, in time constants: the initial state decays to 1e-8.
_RUN_IN = 20.0


def group_delay_s(errors: StreamErrors) -> float:
    """Delay of slow motion [s]: the given delay, or that of the filter.

    A Butterworth filter of order n delays slow motion by `1 / (2 pi bandwidth sin(pi / 2n))`.

    Raises:
        SimulationError: the given delay is shorter than the filter's delay.
    """
    own_s = 1.0 / (2.0 * np.pi * errors.bandwidth_hz * np.sin(np.pi / 2.0 / errors.order))
    if errors.delay_s is None:
        return float(own_s)
    if errors.delay_s < own_s:
        raise SimulationError(
            f"delay_s = {errors.delay_s} with bandwidth_hz = {errors.bandwidth_hz}, order = "
            f"{errors.order}; expected at least the filter's own delay, {own_s:.6f} s"
        )
    return errors.delay_s


def sampled(
    signal: Signal,
    first_s: float,
    rate_hz: float,
    count: int,
    errors: StreamErrors,
    density: float,
    rng: np.random.Generator,
) -> FloatArray:
    """Filtered samples (count,3) of a signal with white noise, at `first_s + k / rate_hz`.

    For a slow signal, a sample equals the signal `group_delay_s` earlier.

    Args:
        signal: function from times (N,) [s] to values (N,3); also called for times before the first sample.
        first_s, rate_hz, count: times of the samples.
        errors: bandwidth, order and delay are used.
        density: noise density below the bandwidth [unit/sqrt(Hz)].
        rng: random generator of the noise.
    """
    if np.isinf(errors.bandwidth_hz):
        t_s = first_s + np.arange(count) / rate_hz - (errors.delay_s or 0.0)
        return signal(t_s) + density * np.sqrt(rate_hz) * rng.normal(size=(count, 3))
    factor = int(np.ceil(max(_GRID_HZ, 10.0 * errors.bandwidth_hz) / rate_hz - 1e-9))
    grid_hz = factor * rate_hz
    sos = butter(errors.order, errors.bandwidth_hz, fs=grid_hz, output="sos")
    extra_s = group_delay_s(errors) - _digital_delay_s(sos, grid_hz)
    run_in = int(np.ceil(_RUN_IN / (2.0 * np.pi * errors.bandwidth_hz) * grid_hz))
    total = run_in + (count - 1) * factor + 1
    state = None
    found = []
    for begin in range(0, total, _BLOCK):
        index = np.arange(begin, min(begin + _BLOCK, total))
        clean = signal(first_s + (index - run_in) / grid_hz - extra_s)
        if state is None:
            state = sosfilt_zi(sos)[:, :, None] * clean[0]
        noisy = clean + density * np.sqrt(grid_hz) * rng.normal(size=clean.shape)
        filtered, state = sosfilt(sos, noisy, axis=0, zi=state)
        found.append(filtered[(index >= run_in) & ((index - run_in) % factor == 0)])
    return np.concatenate(found)


def _digital_delay_s(sos: FloatArray, grid_hz: float) -> float:
    """Group delay at zero frequency of second-order sections (K,6), from the moments of their
    coefficients."""
    lags = np.arange(3)
    b, a = sos[:, :3], sos[:, 3:]
    return float(np.sum(b @ lags / b.sum(axis=1) - a @ lags / a.sum(axis=1)) / grid_hz)
