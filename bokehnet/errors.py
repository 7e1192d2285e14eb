"""The errors that bokehnet raises on purpose.

::

    BokehnetError
    |-- ShapeError         (ValueError)   an array has the wrong rank or size
    |-- ParameterError     (ValueError)   a number or a choice is out of range
    |-- LensError          (ValueError)   a lens cannot exist or cannot focus there
    |-- ConfigError        (ValueError)   a configuration file has a wrong key or value
    |-- ImageFileError     (OSError)      an image cannot be read or written
    |-- DataFileError      (OSError)      a shard or a checkpoint cannot be used
    |-- ModelFileError     (OSError)      network weights are missing, damaged or of another version
    `-- MissingExtraError  (ImportError)  an optional dependency is not installed

Every message says what was wrong, what was expected, what was found and the way out. The command line
prints it as one line; any other exception is a bug and keeps its traceback.
"""

__all__ = [
    "BokehnetError",
    "ConfigError",
    "DataFileError",
    "ImageFileError",
    "LensError",
    "MissingExtraError",
    "ModelFileError",
    "ParameterError",
    "ShapeError",
]


class BokehnetError(Exception):
    """Base of every error that is the caller's to mend."""


class ShapeError(BokehnetError, ValueError):
    """An array has the wrong rank or size."""


class ParameterError(BokehnetError, ValueError):
    """A number or a choice is out of range."""


class LensError(BokehnetError, ValueError):
    """A lens cannot exist, or cannot focus where it was asked to."""


class ConfigError(BokehnetError, ValueError):
    """A configuration file has a wrong key or value."""


class ImageFileError(BokehnetError, OSError):
    """An image file cannot be read or written."""


class DataFileError(BokehnetError, OSError):
    """A training shard or a checkpoint cannot be read, written or resumed."""


class ModelFileError(BokehnetError, OSError):
    """Network weights are missing, damaged or of another version."""


class MissingExtraError(BokehnetError, ImportError):
    """An optional dependency is not installed."""
