# SPDX-License-Identifier: Apache-2.0
"""What the window estimates and from what: states, landmarks, measurements, calibration in use."""
