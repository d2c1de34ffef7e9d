# SPDX-License-Identifier: Apache-2.0
"""Live odometry: a source of events and inertial samples in, poses out as they are made."""
