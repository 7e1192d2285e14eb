"""ONNX Runtime, silent towards the network, and sessions that can be pickled and outlive a fork.

The one place that imports it. From version 1.31 on it reports its use, with a number for the device, unless
it is told not to; here it is told before it is loaded and again before any session.
"""

import ctypes
import os
from collections.abc import Mapping, Sequence
from typing import Any

from bokehnet.forking import ForkSafeLock, renew_in_children

__all__ = ["CPU", "OnnxSession", "load_onnxruntime"]

CPU = ("CPUExecutionProvider",)


def load_onnxruntime() -> Any:
    """Return the module ``onnxruntime``, whose telemetry is off."""
    os.environ["ORT_DISABLE_TELEMETRY"] = (
        "1"  # read when its library is loaded; the call comes too late for that
    )
    import onnxruntime  # here, so that what needs no network starts without it

    onnxruntime.disable_telemetry_events()
    return onnxruntime


class OnnxSession:
    """A network in ONNX Runtime.

    A forked process opens it again with its first picture, as the threads that compute are not there; so does
    one that unpickles it.

    Args:
        model: Content of an ONNX file, or the path of one.
        providers: Execution providers of ONNX Runtime, the preferred one first.
        options: An ``onnxruntime.SessionOptions``, which cannot be pickled, or its attributes and entries by
            name.

    Raises:
        Exception: ONNX Runtime's own, which have no common base: it cannot use the model.
    """

    def __init__(
        self, model: bytes | str, providers: Sequence[str] = CPU, options: Mapping[str, Any] | Any = None
    ) -> None:
        self._model, self._providers, self._options = model, tuple(providers), options
        self._session: Any = None
        self._begin()
        self._opened()

    def inputs(self) -> list[Any]:
        """Its inputs, each with ``name``, ``shape`` and ``type``."""
        found: list[Any] = self._opened().get_inputs()
        return found

    def outputs(self) -> list[Any]:
        """Its outputs, likewise, in the order of :meth:`run`."""
        found: list[Any] = self._opened().get_outputs()
        return found

    def run(self, arrays: Mapping[str, Any], *, release: bool = False) -> list[Any]:
        """Return all its outputs for the inputs by name; ``release`` gives its memory back afterwards."""
        options = None
        if release:
            options = load_onnxruntime().RunOptions()
            options.add_run_config_entry("memory.enable_memory_arena_shrinkage", "cpu:0")
        results: list[Any] = self._opened().run(None, dict(arrays), options)
        return results

    def renew(self) -> None:
        """Leave the parent's session: to end it would wait for threads that are not there."""
        if self._session is not None:
            ctypes.pythonapi.Py_IncRef(ctypes.py_object(self._session))  # so that it never ends
        self._session = None

    def __getstate__(self) -> dict[str, Any]:
        return {"_model": self._model, "_providers": self._providers, "_options": self._options}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self._session = None
        self._begin()

    def _begin(self) -> None:
        self._lock = ForkSafeLock()
        renew_in_children(self)

    def _opened(self) -> Any:
        with self._lock:
            if self._session is None:
                onnxruntime = load_onnxruntime()
                options = self._options
                if options is None or isinstance(options, Mapping):
                    given, options = options or {}, onnxruntime.SessionOptions()
                    for name, value in given.items():
                        if "." in name:
                            options.add_session_config_entry(name, value)
                        else:
                            setattr(options, name, value)
                self._session = onnxruntime.InferenceSession(
                    self._model, options, providers=list(self._providers)
                )
            return self._session
