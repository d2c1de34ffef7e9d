"""Every exception that asyneio raises on purpose. One root, one subclass a room.

A message says what was found, what was expected and what to do about it.
"""


class AsyneioError(Exception):
    """Root of all errors raised on purpose."""


class ConfigError(AsyneioError):
    """A configuration value or key is wrong."""


class CalibrationError(AsyneioError):
    """A calibration is missing, malformed or physically impossible."""


class RecordingError(AsyneioError):
    """A recording is missing, malformed or cannot be used."""


class GeometryError(AsyneioError):
    """A geometric quantity is outside the domain of a model."""


class TrajectoryError(AsyneioError):
    """A trajectory was asked for something it does not hold."""


class InertialError(AsyneioError):
    """Inertial samples cannot be integrated."""


class EstimationError(AsyneioError):
    """The estimator could not produce a usable estimate."""


class EvaluationError(AsyneioError):
    """An estimate cannot be compared with the given ground truth."""


class SimulationError(AsyneioError):
    """A simulation was asked for something impossible."""


class StudyError(AsyneioError):
    """A study is incomplete, or its folder cannot be used."""


class LiveError(AsyneioError):
    """A live source cannot be opened, or sends what cannot be used."""
