"""Your own source of events and inertial samples: front end and odometry, packet by packet.

python examples/packet_by_packet.py
"""

import numpy as np

import asyneio


def between(records, begin_ns, end_ns):  # after `begin_ns`, up to and including `end_ns`
    return records[slice(*np.searchsorted(records["t_ns"], [begin_ns, end_ns], side="right"))]


def main(duration_s=3.0):
    # Replace by your camera: events in the camera clock, samples in the IMU clock, in nanoseconds.
    camera = asyneio.simulate("event_slow", seed=2, duration_s=duration_s).recording
    config, calibration = asyneio.Config(), camera.calibration
    frontend = asyneio.Frontend(config.frontend, camera.width, camera.height)
    odometry = asyneio.Odometry(config, calibration)

    # An observation becomes available some time after its timestamp: packets wait that long for events.
    shift_ns, delay_ns = calibration.timeshift_ns, round(1e9 * config.frontend.max_delay_s)
    begin_ns, last_ns = (int(camera.gyroscope["t_ns"][k]) for k in (0, -1))
    fed_ns, observations, trajectory = begin_ns - shift_ns, frontend.process(camera.events[:0]), []
    for end_ns in range(begin_ns + 50_000_000, last_ns - delay_ns, 50_000_000):
        events_until_ns = end_ns + delay_ns - shift_ns
        new = frontend.process(between(camera.events, fed_ns, events_until_ns))
        new["t_ns"] += shift_ns  # to the clock of the IMU
        observations = np.sort(np.concatenate([observations, new]), order="t_ns", kind="stable")
        streams = (observations, camera.gyroscope, camera.accelerometer)
        packet = asyneio.Packet(end_ns, *(between(stream, begin_ns, end_ns) for stream in streams))
        estimates, report = odometry.process(packet)
        trajectory += estimates
        begin_ns, fed_ns = end_ns, events_until_ns
    print(report.health, report.reason, len(trajectory), "poses", trajectory[-1].T_w_b[:3, 3].round(3))


if __name__ == "__main__":
    main()
