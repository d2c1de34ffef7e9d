"""asyneio: asynchronous event-inertial odometry with Gaussian-process regression."""

__version__ = "0.1.0"
