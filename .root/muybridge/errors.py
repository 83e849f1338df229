"""The errors that a user can cause and mend.

A message says what is wrong, where (file, camera, frame), what would be valid and what to do next, in one
line. The command line prints it and exits with 2; any other exception is a bug and keeps its traceback.
"""


class MuybridgeError(Exception):
    """Base of every error with a remedy."""


class SessionError(MuybridgeError):
    """A session folder cannot be used as it stands."""


class VideoError(MuybridgeError):
    """A video cannot be read, or not to its end."""


class CalibrationError(MuybridgeError):
    """A calibration file is corrupt, of no known format, or does not fit the videos."""


class ModelError(MuybridgeError):
    """A model file is missing or is not one of ours."""


class FormatError(MuybridgeError):
    """A motion file (BVH, C3D, TRC, ...) is malformed."""


class OutputError(MuybridgeError):
    """Results cannot be written where they were asked for."""


class MissingExtraError(MuybridgeError):
    """A command needs an extra (`pip install "muybridge[train]"`) that is not installed."""
