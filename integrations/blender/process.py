"""A bokehnet process outside Blender, which exchanges JSON lines over pipes."""

import importlib.util
import json
import os
import queue
import shutil
import subprocess
import sys
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

from .camera import HostError

__all__ = ["WarmProcess"]


def _interpreter() -> str:
    """Return Blender's own Python if it has bokehnet, otherwise the one of the command ``bokehnet``."""
    command = shutil.which("bokehnet")
    if importlib.util.find_spec("bokehnet") is None and command is not None:
        name = "python.exe" if os.name == "nt" else "python"
        sibling = Path(command).resolve().parent / name
        if sibling.is_file():
            return str(sibling)
    return sys.executable


class WarmProcess:
    """Renders files in a process that starts with the first file and is reused until it is stopped.

    Args:
        python: Interpreter with bokehnet; empty for Blender's own if the extension has wheels, otherwise the
            one beside the command ``bokehnet`` on the path.
    """

    def __init__(self, python: str = "") -> None:
        self.python = python
        self._process: subprocess.Popen[str] | None = None
        self._responses: queue.SimpleQueue[dict[str, Any] | None] = queue.SimpleQueue()
        self._number = 0

    def render(
        self,
        picture: Path,
        settings: dict[str, dict[str, object]],
        output: Path,
        report: Callable[[float], None] = lambda fraction: None,
    ) -> dict[str, Any]:
        """Render one file and return the summary of the rendering.

        Args:
            picture: All-in-focus picture with its depth.
            settings: Settings by groups and fields.
            output: File to write.
            report: Called with the completed fraction, 0 to 1.

        Raises:
            HostError: The file cannot be rendered, or the process died.
        """
        self._start()
        self._number += 1
        files = {"picture": str(picture), "output": str(output), "plain": True}
        self._send({"id": self._number, "settings": settings, **files})
        while True:
            try:
                response = self._responses.get()
            except KeyboardInterrupt:  # Ctrl-C where Blender runs without a window
                self._send({"cancel": self._number})
                raise
            if response is None:
                code = self._process.wait() if self._process else None
                self._process = None
                raise HostError(
                    f"bokehnet: expected an answer, found its process ended with code {code}; try again"
                )
            if response.get("id") != self._number:
                continue
            if "error" in response:
                raise HostError(response["error"]["message"])
            if "result" in response:
                return dict(response["result"])
            report(response["done"] / max(response["total"], 1))

    def stop(self) -> None:
        """End the process if it runs."""
        if self._process is not None and self._process.stdin is not None:
            self._process.stdin.close()
            try:
                self._process.wait(timeout=5)
            except subprocess.TimeoutExpired:
                self._process.kill()
                self._process.wait()
        self._process = None

    def _start(self) -> None:
        if self._process is not None and self._process.poll() is None:
            return
        environment = dict(os.environ)
        if not self.python:  # the wheels precede Blender's own packages, such as its older NumPy
            environment["PYTHONPATH"] = os.pathsep.join(path for path in sys.path if "extensions" in path)
        python = self.python or _interpreter()
        try:
            self._process = subprocess.Popen(
                [python, "-P", "-m", "bokehnet.integrations.warm"],  # -P: no modules of the current folder
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                text=True,
                encoding="utf-8",
                env=environment,
            )
        except OSError as error:
            raise HostError(
                f"preferences: expected a Python with bokehnet, found {python} ({error.strerror}); "
                "set it in the extension's preferences"
            ) from error
        self._responses = queue.SimpleQueue()
        threading.Thread(target=self._read, args=(self._process, self._responses), daemon=True).start()
        first = self._responses.get()
        if first is None or "ready" not in first:
            self.stop()
            raise HostError(
                f"preferences: expected a Python with bokehnet, found {python} without; "
                "pip install bokehnet there, or set another one in the extension's preferences"
            )

    @staticmethod
    def _read(
        process: "subprocess.Popen[str]", responses: "queue.SimpleQueue[dict[str, Any] | None]"
    ) -> None:
        assert process.stdout is not None
        for line in process.stdout:
            responses.put(json.loads(line))
        responses.put(None)

    def _send(self, request: dict[str, Any]) -> None:
        assert self._process is not None
        assert self._process.stdin is not None
        try:
            self._process.stdin.write(json.dumps(request) + "\n")
            self._process.stdin.flush()
        except OSError:
            pass  # it died: render() reports that
