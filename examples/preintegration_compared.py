"""Three rules of preintegration compared: zero-order hold, midpoint, and Gaussian processes.

python examples/preintegration_compared.py
"""

import numpy as np

import asyneio
from asyneio.inertial.gp_preintegration import gp_preintegration
from asyneio.inertial.increments import ImuWindow, SampleNoise
from asyneio.inertial.preintegration import midpoint, zero_order_hold


def main(duration_s=0.2, windows=20):
    run = asyneio.simulate("noise_free", duration_s=6.0)  # gyroscope 1000 Hz, accelerometer 190 Hz
    noise = SampleNoise(gyroscope=1e-4, accelerometer=1e-3)
    gravity = np.array([0.0, 0.0, -9.81])
    for rule in (zero_order_hold, midpoint, gp_preintegration):
        errors = []
        for start_ns in run.truth.start_ns + np.linspace(1e9, 5e9, windows).astype(np.int64):
            times, values = [], []
            for stream in (run.recording.gyroscope, run.recording.accelerometer):
                t_s = (stream["t_ns"] - start_ns) / 1e9
                near = (t_s > -0.02) & (t_s < duration_s + 0.02)
                times.append(t_s[near])
                values.append(stream["xyz"][near])
            window = ImuWindow(times[0], values[0], times[1], values[1], duration_s)
            end = rule(window, np.zeros(6), noise).end()

            a, b = (run.truth.at(start_ns + shift) for shift in (0, round(1e9 * duration_s)))
            r, v = a.T_w_b[0, :3, 3], a.velocity_w[0]
            r = r + v * duration_s + 0.5 * gravity * duration_s**2 + a.T_w_b[0, :3, :3] @ end.r[0]
            errors.append(r - b.T_w_b[0, :3, 3])
        print(f"{rule.__name__:18} position error {1e6 * np.sqrt(np.mean(np.square(errors))):8.3f} um")


if __name__ == "__main__":
    main()
