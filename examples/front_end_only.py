"""The front end alone: events in, feature observations out; no IMU and no calibration needed.

python examples/front_end_only.py
"""

import numpy as np

import asyneio


def main(duration_s=1.0):
    # Replace by events of yours: an array of EVENT_DTYPE (t_ns, x, y, p), or asyneio.open_recording(PATH).
    recording = asyneio.simulate("event_room", duration_s=duration_s).recording
    frontend = asyneio.Frontend(asyneio.Config().frontend, recording.width, recording.height)

    packets = []
    for events in np.array_split(recording.events, 50):
        packets.append(frontend.process(events))  # OBSERVATION_DTYPE: t_ns, id, u, v, covariance
    observations = np.concatenate(packets)

    ids, counts = np.unique(observations["id"], return_counts=True)
    longest = observations[observations["id"] == ids[np.argmax(counts)]]
    seconds = (longest["t_ns"][-1] - longest["t_ns"][0]) / 1e9
    sigma = np.sqrt(longest["covariance"][:, [0, 2]].mean())
    print(f"{recording.events.size} events, {observations.size} observations of {ids.size} features")
    print(f"longest track: {longest.size} positions in {seconds:.2f} s, standard deviation {sigma:.2f} px")
    print(frontend.statistics())


if __name__ == "__main__":
    main()
