"""Render server behind a pipe with a renderer that stays loaded: ``python -P -m bokehnet.integrations.warm``.

Each line of stdin is a request, each line of stdout a response, all JSON objects in UTF-8::

    {"id": 1, "picture": "in.exr", "settings": {"camera": {"f_number": 2}}, "output": "out.exr"}
    {"id": 2, "pixels": {"file": "/dev/shm/bokeh", "width": 64, "height": 48, ...}, "settings": {...}}
    {"cancel": 2}

    {"ready": "VERSION"}
    {"id": 1, "done": 3, "total": 10}
    {"id": 1, "result": {"largest_blur": 12.5, "notes": []}}
    {"id": 2, "error": {"message": "...", "parameter": "camera.f_number", "expected": ..., "remedy": ...}}

VERSION is that of the package. Settings are groups and fields as in TOML files. With ``"plain": true`` an EXR
contains the picture only, none of the other channels of its input. Requests are processed in sequence. The
process ends at the end of stdin.
The fields of ``pixels`` are those of :class:`bokehnet.integrations.shared_pixels.PixelLayout`.
"""

import json
import os
import sys
import threading
import traceback
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from queue import SimpleQueue
from typing import Any, TextIO

from bokehnet.errors import BokehnetError, ParameterError, RenderCancelled
from bokehnet.integrations.shared_pixels import SharedPixels
from bokehnet.io.frame import without_origin
from bokehnet.render.exposure.memory_bounds import check_memory
from bokehnet.render.output import check_output
from bokehnet.render.renderer import BokehRenderer
from bokehnet.render.result import RenderReport
from bokehnet.scene.scene import read_scene
from bokehnet.settings.settings import RenderSettings
from bokehnet.version import __version__

__all__ = ["WarmRenderer", "main"]

_CANCELLED = "cancelled"


class WarmRenderer:
    """Answers requests with one renderer that stays loaded.

    Args:
        responses: Stream for the responses, one per line.

    Examples:
        >>> WarmRenderer(sys.stdout).process(['{"id": 7, "picture": "none.exr", "output": "o.png"}'])
        {"id": 7, "error": {"message": "...", ...}}
    """

    def __init__(self, responses: TextIO) -> None:
        self._responses = responses
        self._renderer = BokehRenderer()
        self._queue: SimpleQueue[tuple[dict[str, Any], threading.Event] | None] = SimpleQueue()
        self._write_lock, self._cancel_lock = threading.Lock(), threading.Lock()
        self._cancels: list[tuple[Any, threading.Event]] = []  # of waiting and running requests

    def process(self, lines: Iterable[str]) -> None:
        """Answer requests until their end; waiting and running requests can be cancelled."""
        reader = threading.Thread(target=self._read, args=(lines,), daemon=True)
        reader.start()
        while (entry := self._queue.get()) is not None:
            self._answer(*entry)

    def _read(self, lines: Iterable[str]) -> None:
        for line in lines:
            try:
                request = json.loads(line)
                if not isinstance(request, dict):
                    raise ValueError(line)
            except ValueError:
                self._send(
                    {"id": None, "error": {"message": f"expected a JSON object in a line, got {line[:80]!r}"}}
                )
                continue
            if "cancel" in request:
                self._cancel(request["cancel"])
            else:
                cancel = threading.Event()
                with self._cancel_lock:
                    self._cancels.append((request.get("id"), cancel))
                self._queue.put((request, cancel))
        self._queue.put(None)

    def _cancel(self, number: Any) -> None:
        """Cancel the requests with this id; ignores ids of answered requests."""
        with self._cancel_lock:
            for known, cancel in self._cancels:
                if known == number:
                    cancel.set()

    def _answer(self, request: dict[str, Any], cancel: threading.Event) -> None:
        number = request.get("id")
        try:
            result = self._rendered(request, number, cancel)
        except RenderCancelled:
            response: dict[str, Any] = {"error": {"message": _CANCELLED}}
        except BokehnetError as error:
            response = {"error": _error_table(error)}
        except Exception:
            traceback.print_exc()
            response = {"error": {"message": f"a bug of bokehnet: {traceback.format_exc(limit=-1)}"}}
        else:
            response = {"result": result}
        with self._cancel_lock:
            self._cancels = [entry for entry in self._cancels if entry[1] is not cancel]
        self._send({"id": number, **response})

    def _rendered(self, request: dict[str, Any], number: Any, cancel: threading.Event) -> dict[str, Any]:
        known = {"id", "picture", "settings", "output", "plain", "pixels"}
        if unknown := sorted(set(request) - known):
            raise ParameterError(unknown[0], f"one of {', '.join(sorted(known))}", request[unknown[0]])
        settings = RenderSettings().updated(request.get("settings", {}))

        def report(done: int, total: int) -> None:
            self._send({"id": number, "done": done, "total": total})

        if "pixels" in request:
            with SharedPixels.opened(request["pixels"]) as pixels:
                scene = pixels.scene()
                result = self._renderer.render(scene, settings, report, cancel=cancel)
                pixels.write(result)
            return _summary(result.report)
        for name in ("picture", "output"):
            if not isinstance(request.get(name), str):
                raise ParameterError(name, "the path of a file", request.get(name))
        check_memory(request["picture"], settings)
        scene = read_scene(request["picture"], settings)
        if request.get("plain") and scene.frame is not None:
            scene = replace(scene, frame=without_origin(scene.frame))
        output = Path(request["output"])
        check_output(output, settings.output, scene.frame)
        result = self._renderer.render(scene, settings, report, cancel=cancel)
        result.save(output)
        return _summary(result.report)

    def _send(self, response: dict[str, Any]) -> None:
        with self._write_lock:  # two threads write
            self._responses.write(json.dumps(response) + "\n")
            self._responses.flush()


def _summary(report: RenderReport) -> dict[str, Any]:
    distance = report.focus_distance
    return {
        "engine": report.engine,
        "largest_blur": report.largest_blur,
        "focus_distance": str(distance) if distance == float("inf") else distance,
        "notes": list(report.notes),
    }


def _error_table(error: BokehnetError) -> dict[str, str]:
    table = {"message": " ".join(str(error).split())}
    if isinstance(error, ParameterError):
        table |= {"parameter": error.parameter, "expected": error.expected, "remedy": error.remedy}
        if error.has_got:
            table["got"] = str(error.got)
    return table


def main() -> None:
    """Answer requests from stdin on stdout, which no other code may write to."""
    os.environ.setdefault("PYTHONSAFEPATH", "1")  # processes import no modules of the current folder
    responses = os.fdopen(os.dup(sys.stdout.fileno()), "w", encoding="utf-8")
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())
    sys.stdout = sys.stderr
    sys.stdin.reconfigure(encoding="utf-8")  # type: ignore[union-attr]
    renderer = WarmRenderer(responses)
    renderer._send({"ready": __version__})
    renderer.process(sys.stdin)


if __name__ == "__main__":
    main()
