"""Rotation of the camera from events or tracks, fitted to the gyroscope: extrinsics, clock offset, scale."""
