# SPDX-License-Identifier: Apache-2.0
"""The exceptions of asyneio: one root, one subclass per subject.

A message states what was found, what was expected and what to do.
"""


class AsyneioError(Exception):
    """Root of all exceptions that asyneio raises deliberately."""


class ConfigError(AsyneioError):
    """A setting is unknown or has a wrong value."""


class CalibrationError(AsyneioError):
    """A calibration is missing, malformed or physically impossible."""


class RecordingError(AsyneioError):
    """A recording is missing, malformed or cannot be used."""


class GeometryError(AsyneioError):
    """A geometric quantity is outside the domain of a model."""


class TrajectoryError(AsyneioError):
    """A trajectory cannot answer a query: a time outside its knots, or no covariance."""


class InertialError(AsyneioError):
    """Inertial samples cannot be integrated."""


class EstimationError(AsyneioError):
    """The estimator could not produce a usable estimate."""


class EvaluationError(AsyneioError):
    """An estimate cannot be compared with the ground truth."""


class SimulationError(AsyneioError):
    """A simulation is unknown or impossible."""


class StudyError(AsyneioError):
    """A study or benchmark is incomplete, or its folder cannot be used."""


class LiveError(AsyneioError):
    """A live source cannot be opened, or sends data that cannot be used."""
