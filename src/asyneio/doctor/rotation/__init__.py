"""Angular rates of the camera, fitted to the gyroscope: extrinsics, time offset, scale."""
