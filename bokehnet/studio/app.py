"""Requests of the page: routes from JSON and files to JSON and pixels."""

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
from bokehnet.studio.failures import failure_message
from bokehnet.studio.files.uploads import UploadTooLargeError, receive, safe_name
from bokehnet.studio.guard import Application, Guard
from bokehnet.studio.looks import depth_offer
from bokehnet.studio.opened import Opened, Region
from bokehnet.studio.panels.panels import panels
from bokehnet.studio.preview.display import SPACES
from bokehnet.studio.preview.overlays import aperture_image, overlay, plain
from bokehnet.studio.preview.preview import Canvas, Picture, refine
from bokehnet.studio.session import Session

__all__ = ["PAGE", "answered", "framed_bytes", "json_of", "make_app"]

PAGE = Path(__file__).parent / "page"
"""Folder with the files of the page."""

_MAX_JSON_BYTES = 2 * 2**20
_MAX_PREVIEW_SIDE_PX = 2560
_MAX_LOUPE_SIDE_PX = 512
_THUMBNAIL_SIZE = (144, 108)
_MAX_CACHED_THUMBNAILS = 200

Handler = Callable[[Request], Awaitable[Response]]


def make_app(session: Session, *, token: str, port: int) -> Application:
    """Return the application behind its guard.

    Args:
        session: Session of the studio.
        token: First part of every path.
        port: Port of the studio.
    """
    api = _Api(session)
    posts = (
        "open",
        "reopen",
        "estimate",
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
        "offer",
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
    routes = [Route(f"/api/{name}", answered(getattr(api, name)), methods=["POST"]) for name in posts]
    routes += [Route(f"/api/{name}", answered(getattr(api, name)), methods=["GET"]) for name in gets]
    files = Mount("/", StaticFiles(directory=PAGE, html=True))

    @asynccontextmanager
    async def lifespan(app: Starlette) -> AsyncIterator[None]:
        yield
        session.close()

    return Guard(Starlette(routes=[*routes, files], lifespan=lifespan), token=token, port=port)


def answered(handler: Handler) -> Handler:
    """Return a handler that reports errors as one line with the setting that caused them."""

    async def answer(request: Request) -> Response:
        try:
            return await handler(request)
        except UploadTooLargeError as error:
            return _error_response(error, 413)
        except RenderCancelled:
            return JSONResponse({"error": "replaced by a newer request"}, 409)
        except BokehnetError as error:
            return _error_response(error, 422)
        except (AttributeError, KeyError, TypeError, ValueError, OverflowError) as error:
            return JSONResponse({"error": f"invalid request: {type(error).__name__}", "path": ""}, 400)
        except Exception as error:  # a bug must not stop the page
            return JSONResponse({"error": failure_message(error)}, 500)

    return answer


def _error_response(error: BokehnetError, status: int) -> Response:
    path = error.parameter if isinstance(error, ParameterError) else ""
    return JSONResponse({"error": " ".join(str(error).split()), "path": path}, status)


async def _count(request: Request) -> int:
    """Return the number of steps of an undo or redo; raise ``ValueError`` unless it is at least 1."""
    count = (await json_of(request)).get("count", 1)
    if not isinstance(count, int) or isinstance(count, bool) or count < 1:
        raise ValueError("expected a count of at least 1")
    return count


async def json_of(request: Request) -> dict[str, Any]:
    """Return the JSON object in the body of a request; raise ``ValueError`` if it is invalid."""
    body = bytearray()
    async for chunk in request.stream():
        body += chunk
        if len(body) > _MAX_JSON_BYTES:
            raise UploadTooLargeError("expected a shorter request")
    try:
        content = json.loads(bytes(body) or b"{}")
    except RecursionError as error:
        raise ValueError("nested too deep") from error
    if not isinstance(content, dict):
        raise ValueError("no object")
    return content


def _framed(picture: Picture, **facts: Any) -> bytes:
    """Return a frame for the page: length of a JSON header, the header, the pixels."""
    height, width = picture.rgba.shape[:2]
    header = {"stage": picture.stage, "width": width, "height": height, **picture.facts, **facts}
    return framed_bytes(picture.rgba.tobytes(), **header)


def framed_bytes(content: bytes, **header: Any) -> bytes:
    """Return a frame for the page: length of a JSON header, the header, the content."""
    encoded = json.dumps(header | {"bytes": len(content)}).encode()
    return struct.pack("<I", len(encoded)) + encoded + content


class _Api:
    """Handlers of the requests, one method each."""

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
        """Open a picture, or with ``role`` its map: ``disparity``, ``depth`` or ``defocus``."""
        session, query = self._session, request.query_params
        name, role = safe_name(query.get("name", "")), query.get("role", "picture")
        path = session.incoming(name)
        await receive(request.stream(), path, request.headers.get("content-length"))
        if role == "picture":
            has_depth = path.suffix.lower() == ".exr"
            settings = session.with_look({"depth": str(path)} if has_depth else {})
            fallback = session.with_look({}) if has_depth else None  # an EXR without depth
            await asyncio.to_thread(session.open, path, settings, fallback=fallback)
        elif role in ("disparity", "depth", "defocus"):
            opened = _open_one(session)
            await asyncio.to_thread(session.open, opened.path, session.with_depth({role: str(path)}))
        else:
            raise ParameterError("role", "picture, disparity, depth or defocus", role)
        return JSONResponse(session.state())

    async def offer(self, request: Request) -> Response:
        return JSONResponse(await asyncio.to_thread(depth_offer))

    async def estimate(self, request: Request) -> Response:
        self._session.estimate(agreed=(await json_of(request)).get("agreed") is True)
        return JSONResponse(self._session.jobs)

    async def reopen(self, request: Request) -> Response:
        path = self._session.incoming("session.bokeh")
        await receive(request.stream(), path, request.headers.get("content-length"))
        await asyncio.to_thread(self._session.reopen, path)
        return JSONResponse(self._session.state())

    async def change(self, request: Request) -> Response:
        self._session.change((await json_of(request)).get("changes", {}))
        return JSONResponse(self._session.state())

    async def wear(self, request: Request) -> Response:
        self._session.apply_preset(str((await json_of(request))["preset"]))
        return JSONResponse(self._session.state())

    async def stroke(self, request: Request) -> Response:
        self._session.stroke((await json_of(request))["stroke"])
        return JSONResponse(self._session.state())

    async def undo(self, request: Request) -> Response:
        self._session.step(back=True, count=await _count(request))
        return JSONResponse(self._session.state())

    async def redo(self, request: Request) -> Response:
        self._session.step(back=False, count=await _count(request))
        return JSONResponse(self._session.state())

    async def export(self, request: Request) -> Response:
        self._session.export(str((await json_of(request))["name"]))
        return JSONResponse(self._session.jobs)

    async def stop(self, request: Request) -> Response:
        self._session.stop_export()
        return JSONResponse(self._session.jobs)

    async def words(self, request: Request) -> Response:
        name = str((await json_of(request))["name"])
        return JSONResponse(await asyncio.to_thread(self._session.equivalents, name))

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
        """Apply changes, if any, and send previews up to the final one."""
        options, session = await json_of(request), self._session
        if options.get("changes"):
            session.change(options["changes"])
        if "preset" in options:
            session.apply_preset(str(options["preset"]))
        opened = _open_one(session)
        size = _fitted(opened, options)
        return await self._streamed(options, opened, size, None)

    async def loupe(self, request: Request) -> Response:
        """Send a region of the picture as in the exported file, at full size."""
        options, opened = await json_of(request), _open_one(self._session)
        width, height = (min(_side(options[side], _MAX_LOUPE_SIDE_PX), full) for side, full in _sides(opened))
        left = min(max(round(float(options["x"]) * opened.size[0] - width / 2), 0), opened.size[0] - width)
        top = min(max(round(float(options["y"]) * opened.size[1] - height / 2), 0), opened.size[1] - height)
        region = Region(x=left, y=top, width=width, height=height)
        return await self._streamed(options, opened, (width, height), region)

    async def thumbnail(self, request: Request) -> Response:
        """Send a thumbnail of the picture with a preset."""
        options, session = await json_of(request), self._session
        opened, shown = _open_one(session), _space(options.get("space"))
        settings = session.with_preset(str(options["preset"]))
        key = (str(options["preset"]), shown, opened.version, str(settings.to_table()))
        if key in opened.thumbnails:
            return Response(_framed(opened.thumbnails[key]), media_type="application/octet-stream")
        size, cancel = opened.fitted(*_THUMBNAIL_SIZE), session.previews.begin_thumbnail()

        def render() -> Picture:
            scene = opened.view(size, settings)
            scaled = opened.at_size(settings, size[0] / opened.size[0])
            task = (scene, scaled, opened.space, shown, "final")
            picture: Picture = session.fine.run(refine, *task, cancel=cancel)
            opened.thumbnails[key] = picture
            while len(opened.thumbnails) > _MAX_CACHED_THUMBNAILS:
                opened.thumbnails.popitem(last=False)
            return picture

        return Response(_framed(await asyncio.to_thread(render)), media_type="application/octet-stream")

    async def plain(self, request: Request) -> Response:
        """Send the picture before any blur."""
        opened, query = _open_one(self._session), request.query_params
        size = _fitted(opened, query)
        shown = _space(query.get("space"))
        picture = await asyncio.to_thread(plain, opened, size, shown)
        return Response(_framed(picture), media_type="application/octet-stream")

    async def overlay(self, request: Request) -> Response:
        """Send an overlay; see :func:`bokehnet.studio.preview.overlays.overlay`."""
        opened, query = _open_one(self._session), request.query_params
        size = _fitted(opened, query)
        picture = await asyncio.to_thread(overlay, opened, self._session.settings, size, query["kind"])
        return Response(_framed(picture), media_type="application/octet-stream")

    async def aperture(self, request: Request) -> Response:
        """Send images of a point of light behind focus, in the middle and in a corner."""
        picture = await asyncio.to_thread(aperture_image, self._session.settings)
        return Response(_framed(picture), media_type="application/octet-stream")

    async def _streamed(
        self, options: dict[str, Any], opened: Opened, size: tuple[int, int], region: Region | None
    ) -> Response:
        """Respond with the first picture or an error; better pictures follow in the same response."""
        session, shown = self._session, _space(options.get("space"))
        settings, lane = session.settings, "loupe" if region else "whole"
        cancel = session.previews.begin(f"{options.get('client', '')!s:.64} {lane}")
        fraction = [0.0]

        def progress(done: int, total: int) -> None:
            fraction[0] = done / max(total, 1)

        canvas = Canvas(size=size, space=shown, region=region, held=bool(options.get("held")))
        stages = session.previews.stages(opened, settings, canvas, cancel, progress)
        first = await asyncio.to_thread(next, stages)
        facts = {
            "settings": session.shown_settings(),
            "version": opened.version,
            "history": session.history,
            "preset": session.preset,
            "equivalents": opened.equivalents(settings, first.facts["focus_disparity"]),
        }

        async def body() -> AsyncIterator[bytes]:
            try:
                yield _framed(first, **facts)
                while True:
                    waiting = asyncio.ensure_future(asyncio.to_thread(_next, stages))
                    waiting.add_done_callback(_retrieve_exception)
                    while not (await asyncio.wait([waiting], timeout=0.2))[0]:
                        yield framed_bytes(b"", stage="progress", share=fraction[0])
                    picture = waiting.result()
                    if picture is None:
                        return
                    yield _framed(picture)
            except RenderCancelled:
                yield framed_bytes(b"", stage="cancelled")
            except BokehnetError as error:
                yield framed_bytes(b"", stage="error", error=" ".join(str(error).split()))
            except Exception as error:  # a bug must not stop the page
                yield framed_bytes(b"", stage="error", error=failure_message(error))
            finally:
                cancel.set()

        return StreamingResponse(body(), media_type="application/octet-stream")


def _retrieve_exception(task: asyncio.Future[Any]) -> None:
    """Retrieve the exception of a task, so that asyncio does not warn after the page has closed."""
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


def _fitted(opened: Opened, options: Mapping[str, Any]) -> tuple[int, int]:
    """Return the size of a preview that fits into the requested size."""
    return opened.fitted(*(_side(options[side], _MAX_PREVIEW_SIDE_PX) for side in ("width", "height")))


def _side(value: Any, maximum: int) -> int:
    return min(max(int(value), 16), maximum)


def _space(name: Any) -> str:
    return name if name in SPACES else "srgb"


def _download(path: Path) -> Response:
    return FileResponse(path, filename=path.name, media_type="application/octet-stream")
