# SPDX-License-Identifier: Apache-2.0
"""Angular rates of the camera, fitted to the gyroscope: extrinsics, time offset, scale."""
