"""ONNX Runtime without telemetry, and sessions that can be pickled and survive a fork.

Only this module imports onnxruntime. Since version 1.31 it reports its use with a device identifier unless
disabled; this module disables it before loading it and again before any session.
"""

import ctypes
import os
import threading
from collections.abc import Mapping, Sequence
from typing import Any

from bokehnet.processes.forking import ForkSafeLock, renew_in_children

__all__ = ["CPU", "OnnxSession", "load_onnxruntime"]

CPU = ("CPUExecutionProvider",)


def load_onnxruntime() -> Any:
    """Return the module ``onnxruntime`` with telemetry disabled."""
    os.environ["ORT_DISABLE_TELEMETRY"] = "1"  # read on loading its library, before the call below
    import onnxruntime  # imported late: not needed without networks

    onnxruntime.disable_telemetry_events()
    return onnxruntime


class OnnxSession:
    """Network in ONNX Runtime.

    A forked process reopens it on first use, as the parent's worker threads do not exist there; unpickling
    reopens it as well.

    Args:
        model: Content or path of an ONNX file.
        providers: Execution providers of ONNX Runtime, the preferred one first.
        options: ``onnxruntime.SessionOptions``, which cannot be pickled, or its attributes and configuration
            entries by name.

    Raises:
        Exception: ONNX Runtime cannot use the model; its exceptions have no common base.
    """

    def __init__(
        self, model: bytes | str, providers: Sequence[str] = CPU, options: Mapping[str, Any] | Any = None
    ) -> None:
        self._model, self._providers, self._options = model, tuple(providers), options
        self._session: Any = None
        self._begin()
        self._opened()

    def inputs(self) -> list[Any]:
        """Return the inputs, each with ``name``, ``shape`` and ``type``."""
        inputs: list[Any] = self._opened().get_inputs()
        return inputs

    def outputs(self) -> list[Any]:
        """Return the outputs, each with ``name``, ``shape`` and ``type``, in the order of :meth:`run`."""
        outputs: list[Any] = self._opened().get_outputs()
        return outputs

    def run(
        self, arrays: Mapping[str, Any], *, release: bool = False, max_seconds: float | None = None
    ) -> list[Any]:
        """Return all outputs for the inputs by name.

        Args:
            arrays: Inputs by name.
            release: True to free the memory of the session afterwards.
            max_seconds: Time after which the run is stopped and raises; None for no limit.
        """
        options: Any = None
        timer = None
        if release or max_seconds is not None:
            options = load_onnxruntime().RunOptions()
        if release:
            options.add_run_config_entry("memory.enable_memory_arena_shrinkage", "cpu:0")
        if max_seconds is not None:
            timer = threading.Timer(max_seconds, setattr, (options, "terminate", True))
            timer.daemon = True
            timer.start()
        try:
            results: list[Any] = self._opened().run(None, dict(arrays), options)
        finally:
            if timer is not None:
                timer.cancel()
        return results

    def renew(self) -> None:
        """Abandon the parent's session: destroying it would wait for threads that do not exist here."""
        if self._session is not None:
            ctypes.pythonapi.Py_IncRef(ctypes.py_object(self._session))  # never destroyed
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
                    entries, options = options or {}, onnxruntime.SessionOptions()
                    for name, value in entries.items():
                        if "." in name:
                            options.add_session_config_entry(name, value)
                        else:
                            setattr(options, name, value)
                self._session = onnxruntime.InferenceSession(
                    self._model, options, providers=list(self._providers)
                )
            return self._session
