"""Commands that print the figures of the README and the docs."""

import sys
from types import TracebackType

# Packages of extras, and the extra that has all that benchmarks need of it.
_EXTRAS = {"torch": "train", "kornia": "train", "scipy": "train", "skimage": "train", "playwright": "dev"}


def _report_missing(kind: type[BaseException], error: BaseException, trace: TracebackType | None) -> None:
    """Print one line for a missing package of an extra; other errors keep their traceback."""
    name = (error.name or "").split(".")[0] if isinstance(error, ModuleNotFoundError) else ""
    if name in _EXTRAS:
        print(f"this benchmark needs {name}: pip install 'bokehnet[{_EXTRAS[name]}]'", file=sys.stderr)
    else:
        sys.__excepthook__(kind, error, trace)


if sys.argv[0] == "-m":  # a command of this package is about to run
    sys.excepthook = _report_missing
