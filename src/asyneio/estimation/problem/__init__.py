"""What the window estimates and from what: states, landmarks, measurements, calibration in use."""
