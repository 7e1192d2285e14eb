"""Requests of the page of a scene: its state, and pictures as frames of a JSON header and a JPEG."""

import asyncio
import math
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import FileResponse, JSONResponse, Response, StreamingResponse
from starlette.routing import Mount, Route
from starlette.staticfiles import StaticFiles

from bokehnet.errors import BokehnetError
from bokehnet.studio.app import PAGE, answered, framed_bytes, json_of
from bokehnet.studio.guard import Application, Guard
from bokehnet.studio.scene_preview.session import ScenePicture, SceneSession

__all__ = ["make_scene_app"]

_FRAMES = "application/octet-stream"


def make_scene_app(session: SceneSession, *, token: str, port: int) -> Application:
    """Return the application of a scene behind its guard.

    Args:
        session: Session of the previewer.
        token: First part of every path.
        port: Port of the studio.
    """

    async def page(request: Request) -> Response:
        return FileResponse(PAGE / "scene.html")

    async def state(request: Request) -> Response:
        return JSONResponse(session.state())

    async def view(request: Request) -> Response:
        """Send the draft, or an error; traced pictures follow in the same response, unless the view moves."""
        values = await json_of(request)
        pictures = session.pictures(values)
        first = await asyncio.to_thread(next, pictures)
        if values.get("moving"):
            return Response(_framed(first), media_type=_FRAMES)

        async def body() -> AsyncIterator[bytes]:
            try:
                picture: ScenePicture | None = first
                while picture is not None:
                    yield _framed(picture)
                    picture = await asyncio.to_thread(next, pictures, None)
                yield framed_bytes(b"", stage="done")
            except BokehnetError as error:
                yield framed_bytes(b"", stage="error", error=" ".join(str(error).split()))

        return StreamingResponse(body(), media_type=_FRAMES)

    @asynccontextmanager
    async def lifespan(app: Starlette) -> AsyncIterator[None]:
        yield
        session.close()

    routes = [
        Route("/", page),
        Route("/api/scene", answered(state)),
        Route("/api/view", answered(view), methods=["POST"]),
        Mount("/", StaticFiles(directory=PAGE)),
    ]
    return Guard(Starlette(routes=routes, lifespan=lifespan), token=token, port=port)


def _framed(picture: ScenePicture) -> bytes:
    focus = picture.focus_distance if math.isfinite(picture.focus_distance) else None
    return framed_bytes(picture.jpeg, stage=picture.stage, samples=picture.samples, focus_distance=focus)
