"""Poses in, a Gaussian-process trajectory out: interpolate, differentiate, and ask for the covariance.

python examples/trajectory_from_poses.py
"""

import numpy as np

import asyneio
from asyneio.trajectory.from_poses import trajectory_from_poses


def main():
    # Replace by poses of yours, such as motion capture: times [ns] and matrices (K,4,4).
    truth = asyneio.simulate("moderate", duration_s=4.0).truth
    t_ns = truth.start_ns + 50_000_000 * np.arange(1, 75)  # 20 Hz
    T_w_b = truth.at(t_ns).T_w_b
    noise_m = 0.002
    T_w_b[:, :3, 3] += np.random.default_rng(0).normal(0.0, noise_m, (len(t_ns), 3))

    sigma = np.repeat([1e-4, noise_m], 3)  # of a pose: rotation [rad], position [m]
    root_density = np.repeat([20.0, 20.0], 3)  # of the jerk [rad/s^3, m/s^3 per sqrt(Hz)]
    trajectory = trajectory_from_poses(t_ns, T_w_b, sigma, root_density)

    between = t_ns[10:-10] + 25_000_000  # any time between first and last pose
    expected = truth.at(between)
    position = trajectory.pose(between)[:, :3, 3]
    velocity, acceleration = trajectory.velocity(between), trajectory.acceleration(between)
    predicted_m = np.sqrt(trajectory.covariance(between)[:, 3:6, 3:6].trace(axis1=1, axis2=2) / 3)

    error_m = position - expected.T_w_b[:, :3, 3]
    print(f"position error {1e3 * np.sqrt(np.mean(error_m**2)):.2f} mm, ", end="")
    print(f"predicted {1e3 * predicted_m.mean():.2f} mm, of the poses {1e3 * noise_m:.2f} mm")
    print(f"velocity error {np.sqrt(np.mean((velocity - expected.velocity_w) ** 2)):.3f} m/s")
    print("acceleration at the first time [m/s^2]:", acceleration[0].round(2))


if __name__ == "__main__":
    main()
