"""Report of a missing package of an extra, for the scripts of ``train`` and ``benchmarks``."""

import sys
from types import TracebackType

from bokehnet.errors import MissingExtraError

__all__ = ["report_missing_packages"]

# Modules of optional packages that scripts and the package import, and the extra of each.
_EXTRAS = {
    "PIL": "avif",
    "av": "video",
    "embreex": "train",
    "fastapi": "serve",
    "flip_evaluator": "train",
    "httpx": "dev",
    "kornia": "train",
    "matplotlib": "plot",
    "mitsuba": "dev",
    "onnx": "train",
    "onnxscript": "train",
    "playwright": "dev",
    "prometheus_client": "serve",
    "pytorch_msssim": "train",
    "ray": "train-cluster",
    "scipy": "train",
    "skimage": "train",
    "starlette": "studio",
    "tensorboard": "train",
    "torch": "train",
    "trimesh": "trace",
    "uvicorn": "studio",
}


def report_missing_packages() -> None:
    """Print one line, without a traceback, where a script run by ``python -m`` lacks a package of an extra.

    The script's package has to call this; Python imports it while ``sys.argv[0]`` is still ``-m``.
    """
    if sys.argv[0] == "-m":
        sys.excepthook = _report


def _report(kind: type[BaseException], error: BaseException, trace: TracebackType | None) -> None:
    """Print one line for a missing package of an extra; other errors keep their traceback."""
    name = (error.name or "").split(".")[0] if isinstance(error, ModuleNotFoundError) else ""
    if name in _EXTRAS:
        print(f"error: this needs {name}: pip install 'bokehnet[{_EXTRAS[name]}]'", file=sys.stderr)
    elif isinstance(error, MissingExtraError):
        print(f"error: {error}", file=sys.stderr)
    else:
        sys.__excepthook__(kind, error, trace)
