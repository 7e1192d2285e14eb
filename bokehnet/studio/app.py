"""What the page can ask for: routes from JSON and files to JSON and pixels."""

import asyncio
import json
import struct
from collections.abc import AsyncIterator, Awaitable, Callable, Mapping
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import FileResponse, JSONResponse, PlainTextResponse, Response, StreamingResponse
from starlette.routing import Mount, Route
from starlette.staticfiles import StaticFiles

from bokehnet.errors import BokehnetError, ParameterError, RenderCancelled
from bokehnet.settings.preset import load_preset, presets
from bokehnet.settings.settings import InputSettings, RenderSettings
from bokehnet.studio.display import SPACES
from bokehnet.studio.guard import Application, Guard
from bokehnet.studio.opened import Opened, Region
from bokehnet.studio.overlays import aperture_image, overlay, plain
from bokehnet.studio.panels import panels
from bokehnet.studio.preview import Picture, refine
from bokehnet.studio.session import Session
from bokehnet.studio.uploads import UploadTooLargeError, receive, safe_name

__all__ = ["PAGE", "make_app"]

PAGE = Path(__file__).parent / "page"
"""The files of the page."""

_MOST_JSON = 2 * 2**20
_LARGEST_SIDE = 2560  # pixels of a preview
_LARGEST_LOUPE = 512
_THUMBNAIL = (144, 108)

Handler = Callable[[Request], Awaitable[Response]]


def make_app(session: Session, *, token: str, port: int) -> Application:
    """Return the application behind its guard.

    Args:
        session: What is open.
        token: First part of every path.
        port: On which it listens.
    """
    api = _Api(session)
    posts = (
        "open",
        "reopen",
        "change",
        "wear",
        "stroke",
        "undo",
        "redo",
        "export",
        "stop",
        "preview",
        "loupe",
        "thumbnail",
        "words",
    )
    gets = (
        "state",
        "jobs",
        "panels",
        "presets",
        "plain",
        "overlay",
        "aperture",
        "result",
        "map",
        "preset",
        "session",
    )
    routes = [Route(f"/api/{name}", _answered(getattr(api, name)), methods=["POST"]) for name in posts]
    routes += [Route(f"/api/{name}", _answered(getattr(api, name)), methods=["GET"]) for name in gets]
    files = Mount("/", StaticFiles(directory=PAGE, html=True))

    @asynccontextmanager
    async def lifespan(app: Starlette) -> AsyncIterator[None]:
        yield
        session.close()

    return Guard(Starlette(routes=[*routes, files], lifespan=lifespan), token=token, port=port)


def _answered(handler: Handler) -> Handler:
    """The handler with our errors as one line, and the setting that caused each."""

    async def answer(request: Request) -> Response:
        try:
            return await handler(request)
        except UploadTooLargeError as error:
            return _told(error, 413)
        except RenderCancelled:
            return JSONResponse({"error": "another request came"}, 409)
        except BokehnetError as error:
            return _told(error, 422)
        except (AttributeError, KeyError, TypeError, ValueError, OverflowError) as error:
            return JSONResponse(
                {"error": f"expected another request: {type(error).__name__}", "path": ""}, 400
            )
        except Exception as error:  # a fault of ours is told, and the page goes on
            return JSONResponse({"error": _fault(error)}, 500)

    return answer


def _told(error: BokehnetError, status: int) -> Response:
    path = error.parameter if isinstance(error, ParameterError) else ""
    return JSONResponse({"error": " ".join(str(error).split()), "path": path}, status)


def _fault(error: Exception) -> str:
    """One line of what no check of ours foresaw."""
    return " ".join(f"failed by a fault: {type(error).__name__}: {error}".split())


async def _json(request: Request) -> dict[str, Any]:
    """The body of a request; ``ValueError`` where it is no JSON object or too long."""
    body = bytearray()
    async for chunk in request.stream():
        body += chunk
        if len(body) > _MOST_JSON:
            raise UploadTooLargeError("expected a shorter request")
    try:
        found = json.loads(bytes(body) or b"{}")
    except RecursionError as error:
        raise ValueError("nested too deep") from error
    if not isinstance(found, dict):
        raise ValueError("no object")
    return found


def _framed(picture: Picture, **facts: Any) -> bytes:
    """A picture as the page reads it: length of a JSON header, the header, the pixels."""
    height, width = picture.rgba.shape[:2]
    header = {"stage": picture.stage, "width": width, "height": height, **picture.facts, **facts}
    told = json.dumps(header | {"bytes": picture.rgba.nbytes}).encode()
    return struct.pack("<I", len(told)) + told + picture.rgba.tobytes()


def _line(**facts: Any) -> bytes:
    told = json.dumps(facts | {"bytes": 0}).encode()
    return struct.pack("<I", len(told)) + told


class _Api:
    """One method for each thing that the page can ask for."""

    def __init__(self, session: Session) -> None:
        self._session = session

    async def state(self, request: Request) -> Response:
        return JSONResponse(self._session.state())

    async def jobs(self, request: Request) -> Response:
        return JSONResponse(self._session.jobs)

    async def panels(self, request: Request) -> Response:
        return JSONResponse(panels())

    async def presets(self, request: Request) -> Response:
        return JSONResponse(
            [{"name": name, "description": load_preset(name).description} for name in presets()]
        )

    async def open(self, request: Request) -> Response:
        """A picture, or with ``role`` its map: ``disparity``, ``depth`` or ``defocus``."""
        session, query = self._session, request.query_params
        name, role = safe_name(query.get("name", "")), query.get("role", "picture")
        path = session.incoming(name)
        await receive(request.stream(), path, request.headers.get("content-length"))
        if role == "picture":
            own = path.suffix.lower() == ".exr"
            settings = RenderSettings().updated({"input": {"depth": str(path)}} if own else {})
            try:
                await asyncio.to_thread(session.open, path, settings)
            except BokehnetError:
                if not own:
                    raise
                await asyncio.to_thread(session.open, path, RenderSettings())
        elif role in ("disparity", "depth", "defocus"):
            opened = _open_one(session)
            look = RenderSettings().updated(
                {
                    group: fields
                    for group, fields in session.settings.to_table().items()
                    if group not in ("input", "depth", "focus", "camera")
                }
            )
            source = {InputSettings.GROUP: {role: str(path)}}
            await asyncio.to_thread(session.open, opened.path, look.updated(source))
        else:
            raise ParameterError("role", "picture, disparity, depth or defocus", role)
        return JSONResponse(session.state())

    async def reopen(self, request: Request) -> Response:
        path = self._session.incoming("session.bokeh")
        await receive(request.stream(), path, request.headers.get("content-length"))
        await asyncio.to_thread(self._session.reopen, path)
        return JSONResponse(self._session.state())

    async def change(self, request: Request) -> Response:
        self._session.change((await _json(request)).get("changes", {}))
        return JSONResponse(self._session.state())

    async def wear(self, request: Request) -> Response:
        self._session.wear(str((await _json(request))["preset"]))
        return JSONResponse(self._session.state())

    async def stroke(self, request: Request) -> Response:
        self._session.stroke((await _json(request))["stroke"])
        return JSONResponse(self._session.state())

    async def undo(self, request: Request) -> Response:
        self._session.step(back=True)
        return JSONResponse(self._session.state())

    async def redo(self, request: Request) -> Response:
        self._session.step(back=False)
        return JSONResponse(self._session.state())

    async def export(self, request: Request) -> Response:
        self._session.export(str((await _json(request))["name"]))
        return JSONResponse(self._session.jobs)

    async def stop(self, request: Request) -> Response:
        self._session.stop_export()
        return JSONResponse(self._session.jobs)

    async def words(self, request: Request) -> Response:
        return JSONResponse(await asyncio.to_thread(self._session.words, str((await _json(request))["name"])))

    async def result(self, request: Request) -> Response:
        return _download(self._session.result())

    async def map(self, request: Request) -> Response:
        return _download(await asyncio.to_thread(self._session.painted_map))

    async def preset(self, request: Request) -> Response:
        text = await asyncio.to_thread(self._session.preset_text)
        headers = {"content-disposition": 'attachment; filename="preset.toml"'}
        return PlainTextResponse(text, headers=headers)

    async def session(self, request: Request) -> Response:
        return _download(await asyncio.to_thread(self._session.save))

    async def preview(self, request: Request) -> Response:
        """Take changes, if any, and send previews until the engine's own is done."""
        asked, session = await _json(request), self._session
        if asked.get("changes"):
            session.change(asked["changes"])
        if "preset" in asked:
            session.wear(str(asked["preset"]))
        opened = _open_one(session)
        size = _fitted(opened, asked)
        return await self._streamed(asked, opened, size, None)

    async def loupe(self, request: Request) -> Response:
        """Send a part of the picture as it will be in the file, at the file's size."""
        asked, opened = await _json(request), _open_one(self._session)
        width, height = (min(_side(asked[side], _LARGEST_LOUPE), full) for side, full in _sides(opened))
        left = min(max(round(float(asked["x"]) * opened.size[0] - width / 2), 0), opened.size[0] - width)
        top = min(max(round(float(asked["y"]) * opened.size[1] - height / 2), 0), opened.size[1] - height)
        region = Region(x=left, y=top, width=width, height=height)
        return await self._streamed(asked, opened, (width, height), region)

    async def thumbnail(self, request: Request) -> Response:
        """Send this picture with a preset's look."""
        asked, session = await _json(request), self._session
        opened, shown = _open_one(session), _space(asked.get("space"))
        settings = session.dressed(str(asked["preset"]))
        size, cancel = opened.fitted(*_THUMBNAIL), session.previews.begin_thumbnail()

        def render() -> Picture:
            scene = opened.view(size, settings)
            told = opened.at_size(settings, size[0] / opened.size[0])
            task = (scene, told, opened.space, shown, "final")
            found: Picture = session.fine.run(refine, *task, cancel=cancel)
            return found

        return Response(_framed(await asyncio.to_thread(render)), media_type="application/octet-stream")

    async def plain(self, request: Request) -> Response:
        """Send the picture as it was before."""
        opened, query = _open_one(self._session), request.query_params
        size = _fitted(opened, query)
        shown = _space(query.get("space"))
        made = await asyncio.to_thread(plain, opened, size, shown)
        return Response(_framed(made), media_type="application/octet-stream")

    async def overlay(self, request: Request) -> Response:
        """Send what is laid over the picture: ``depth``, ``focus`` or ``confidence``."""
        opened, query = _open_one(self._session), request.query_params
        size = _fitted(opened, query)
        made = await asyncio.to_thread(overlay, opened, self._session.settings, size, query["kind"])
        return Response(_framed(made), media_type="application/octet-stream")

    async def aperture(self, request: Request) -> Response:
        """Send what a point of light behind focus becomes, in the middle and in a corner."""
        made = await asyncio.to_thread(aperture_image, self._session.settings)
        return Response(_framed(made), media_type="application/octet-stream")

    async def _streamed(
        self, asked: dict[str, Any], opened: Opened, size: tuple[int, int], region: Region | None
    ) -> Response:
        """Answer with the first picture, or an error; the better ones follow in the same answer."""
        session, shown = self._session, _space(asked.get("space"))
        settings, lane = session.settings, "loupe" if region else "whole"
        cancel = session.previews.begin(f"{asked.get('client', '')!s:.64} {lane}")
        share = [0.0]

        def progress(done: int, total: int) -> None:
            share[0] = done / max(total, 1)

        held = bool(asked.get("held"))
        stages = session.previews.stages(opened, settings, size, shown, cancel, progress, region, held)
        first = await asyncio.to_thread(next, stages)
        facts = {"settings": session.told_settings(), "version": opened.version}

        async def body() -> AsyncIterator[bytes]:
            try:
                yield _framed(first, **facts)
                while True:
                    waiting = asyncio.ensure_future(asyncio.to_thread(_next, stages))
                    waiting.add_done_callback(_looked_at)
                    while not (await asyncio.wait([waiting], timeout=0.2))[0]:
                        yield _line(stage="progress", share=share[0])
                    made = waiting.result()
                    if made is None:
                        return
                    yield _framed(made)
            except RenderCancelled:
                yield _line(stage="cancelled")
            except BokehnetError as error:
                yield _line(stage="error", error=" ".join(str(error).split()))
            except Exception as error:  # a fault of ours is told, and the page goes on
                yield _line(stage="error", error=_fault(error))
            finally:
                cancel.set()

        return StreamingResponse(body(), media_type="application/octet-stream")


def _looked_at(task: asyncio.Future[Any]) -> None:
    """Look at what a task ended by: nobody else does where the page has gone."""
    if not task.cancelled():
        task.exception()


def _next(stages: Any) -> Picture | None:
    return next(stages, None)


def _open_one(session: Session) -> Opened:
    if session.opened is None:
        raise BokehnetError("expected an open picture; drop one on the page")
    return session.opened


def _sides(opened: Opened) -> tuple[tuple[str, int], tuple[str, int]]:
    return ("width", opened.size[0]), ("height", opened.size[1])


def _fitted(opened: Opened, asked: Mapping[str, Any]) -> tuple[int, int]:
    """Size of a preview that the page has so many pixels for."""
    return opened.fitted(*(_side(asked[side], _LARGEST_SIDE) for side in ("width", "height")))


def _side(value: Any, most: int) -> int:
    return min(max(int(value), 16), most)


def _space(name: Any) -> str:
    return name if name in SPACES else "srgb"


def _download(path: Path) -> Response:
    return FileResponse(path, filename=path.name, media_type="application/octet-stream")
