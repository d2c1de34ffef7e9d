# SPDX-License-Identifier: Apache-2.0
"""Event-driven front end: from events to asynchronous feature trajectories (Algorithm 1 of the paper)."""

from asyneio.frontend.frontend import Frontend as Frontend
from asyneio.frontend.frontend import gyroscope_in_camera as gyroscope_in_camera
from asyneio.frontend.tracker import FrontendStatistics as FrontendStatistics
