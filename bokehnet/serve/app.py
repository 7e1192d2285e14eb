"""What HTTP sees: jobs, their progress and results, health and metrics."""

import asyncio
import hashlib
import json
import shutil
import time
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from typing import Annotated, Any

from fastapi import Depends, FastAPI, File, Form, Header, Request, Response, UploadFile
from fastapi.exceptions import RequestValidationError
from fastapi.responses import FileResponse, JSONResponse, StreamingResponse
from starlette.exceptions import HTTPException

from bokehnet.errors import BokehnetError, ParameterError
from bokehnet.serve.metrics import Metrics
from bokehnet.serve.pool import Pool
from bokehnet.serve.problems import CANCELLED, MEDIA_TYPE, Problem, problem_of
from bokehnet.serve.requests import FORMATS, check_request, file_name
from bokehnet.serve.service_settings import ServiceSettings
from bokehnet.serve.store import JobStore, QueueFull
from bokehnet.serve.tokens import Tokens
from bokehnet.serve.uploads import BoundedBody, fetch, keep
from bokehnet.version import __version__

__all__ = ["make_app"]

_ENDED = ("done", "failed", "cancelled")
_LOOK, _ALIVE = 0.1, 10.0  # s between looks at a job that is followed, and between signs of life
_RETRY = {"Retry-After": "2"}


def make_app(settings: ServiceSettings) -> FastAPI:
    """Make the application of a service; its workers start and end with it.

    Args:
        settings: All that it is told.

    Raises:
        ConfigError: The file of tokens is wrong.
    """
    tokens = Tokens(settings.tokens)
    store = JobStore(settings.folder, settings.queue, settings.keep)
    metrics = Metrics(store.unfinished)
    pool = Pool(store, settings, metrics)

    @asynccontextmanager
    async def lifespan(app: FastAPI) -> AsyncIterator[None]:
        pool.start()
        yield
        await asyncio.to_thread(pool.drain, settings.drain)

    app = FastAPI(
        title="bokehnet",
        version=__version__,
        description="Bokeh from an all-in-focus picture and its depth. Errors are documents of RFC 9457.",
        lifespan=lifespan,
        docs_url=None,  # its page would load scripts from elsewhere
        redoc_url=None,
    )
    app.state.pool = pool
    _answer_problems(app, metrics)
    app.add_middleware(
        BoundedBody,
        most=settings.max_upload,
        patience=settings.patience,
        admit=lambda headers: tokens.client(headers.get(b"authorization", b"").decode("latin-1")),
        answer=lambda problem: _told(problem, metrics),
    )
    _add_health(app, tokens, metrics, pool)
    _add_jobs(app, settings, tokens, store, metrics, pool)
    return app


def _add_health(app: FastAPI, tokens: Tokens, metrics: Metrics, pool: Pool) -> None:
    @app.get("/healthz", tags=["health"])
    def healthz() -> dict[str, str]:
        """Whether the process answers."""
        return {"status": "ok", "version": __version__}

    @app.get("/readyz", tags=["health"])
    def readyz() -> dict[str, str]:
        """Whether new jobs are taken."""
        _check_open(pool)
        return {"status": "ready"}

    @app.get("/metrics", tags=["health"])
    def metrics_text(authorization: Annotated[str | None, Header()] = None) -> Response:
        """Counters in Prometheus' text format."""
        tokens.client(authorization)
        return Response(metrics.text(), media_type="text/plain; version=0.0.4; charset=utf-8")


def _add_jobs(
    app: FastAPI,
    settings: ServiceSettings,
    tokens: Tokens,
    store: JobStore,
    metrics: Metrics,
    pool: Pool,
) -> None:
    def client(authorization: Annotated[str | None, Header()] = None) -> str:
        return tokens.client(authorization)

    Client = Annotated[str, Depends(client)]  # noqa: N806  # a type
    Sent = Annotated[UploadFile | None, File()]  # noqa: N806

    def known(job: str, owner: str) -> dict[str, Any]:
        view = store.view(job)
        if view is None or view["owner"] != owner:
            raise Problem("not-found", f"there is no job {job}; it may have been removed")
        return view

    @app.post("/v1/jobs", status_code=202, tags=["jobs"])
    def submit(
        owner: Client,
        image: Sent = None,
        disparity: Sent = None,
        depth: Sent = None,
        defocus: Sent = None,
        matte: Sent = None,
        aperture_image: Sent = None,
        image_url: Annotated[str | None, Form()] = None,
        settings_json: Annotated[str, Form(alias="settings")] = "{}",
        preset: Annotated[str | None, Form()] = None,
        output: Annotated[str, Form(alias="format")] = "png",
        idempotency_key: Annotated[str | None, Header(max_length=255)] = None,
    ) -> JSONResponse:
        """Accept a picture, what tells its depth, and settings: a JSON object of groups as in TOML files.

        The same idempotency key brings the same job, however often it is sent.
        """
        _check_open(pool)
        sent = {"image": image, "disparity": disparity, "depth": depth, "defocus": defocus}
        sent |= {"matte": matte, "aperture_image": aperture_image}
        came = {field: file for field, file in sent.items() if file is not None}
        if (image is None) == (image_url is None):
            raise ParameterError("image", "one of `image` and `image_url`", shown="both" if image else "none")
        names = {field: file_name(field, file.filename) for field, file in came.items()}
        if image_url is not None:
            names["image"] = file_name("image", image_url.split("?")[0])
        request = check_request(settings_json, preset, output, names)
        incoming = store.incoming()
        try:
            hashes = {field: keep(file.file, incoming / names[field]) for field, file in came.items()}
            if image_url is not None:
                hosts = settings.fetch_from or ()
                target = incoming / names["image"]
                hashes["image"] = fetch(image_url, hosts, target, settings.max_upload, settings.patience)
            told = json.dumps([request, hashes], sort_keys=True)
            fingerprint = hashlib.sha256(told.encode()).hexdigest()
            request |= {"owner": owner, "fingerprint": fingerprint, "memory": settings.memory_limit}
            job, new = store.submit(incoming, request, idempotency_key)
        except QueueFull:
            detail = f"expected fewer than {settings.queue} unfinished jobs; try again later"
            raise Problem("queue-full", detail, headers=_RETRY) from None
        finally:
            shutil.rmtree(incoming, ignore_errors=True)
        view = known(job, owner)
        if not new and view["fingerprint"] != fingerprint:
            detail = (
                "Idempotency-Key: expected one for each request, found one of another request; make a new one"
            )
            raise Problem("idempotency", detail)
        if new:
            metrics.accepted.inc()
            pool.wake()
        code = 202 if view["state"] not in _ENDED else 200
        return JSONResponse(_shown(view), code, {"Location": f"/v1/jobs/{job}"})

    @app.get("/v1/jobs/{job}", tags=["jobs"])
    def state(job: str, owner: Client) -> dict[str, Any]:
        """How far a job is, and what became of it."""
        return _shown(known(job, owner))

    @app.get("/v1/jobs/{job}/result", tags=["jobs"], response_class=FileResponse)
    def result(job: str, owner: Client) -> Response:
        """The picture."""
        view = known(job, owner)
        if view["state"] == "done":
            name = view["result"]
            return FileResponse(store.file(job, name), media_type=FORMATS[name.rpartition(".")[2]])
        if view["state"] in _ENDED:
            document = view.get("problem") or CANCELLED.document()
            return JSONResponse(document, document["status"], media_type=MEDIA_TYPE)
        raise Problem("not-done", f"expected a job that is done, found it {view['state']}", headers=_RETRY)

    @app.get("/v1/jobs/{job}/events", tags=["jobs"], response_class=StreamingResponse)
    async def events(job: str, owner: Client) -> StreamingResponse:
        """Progress as server-sent events: ``progress`` as it changes, then one named as the job ended."""
        await asyncio.to_thread(known, job, owner)
        return StreamingResponse(
            _events(lambda: store.view(job)),
            media_type="text/event-stream",
            headers={"Cache-Control": "no-store", "X-Accel-Buffering": "no"},
        )

    @app.delete("/v1/jobs/{job}", status_code=204, tags=["jobs"])
    def cancel(job: str, owner: Client) -> Response:
        """Stop a job, or remove one that has ended with its files."""
        if known(job, owner)["state"] in _ENDED:
            store.remove(job)
        else:
            if store.finish(job, {"state": "cancelled", "problem": CANCELLED.document()}):
                metrics.finished.labels("cancelled").inc()
        return Response(status_code=204)


def _check_open(pool: Pool) -> None:
    if pool.draining:
        raise Problem("draining", "the service is stopping; ask another one", headers=_RETRY)


async def _events(look: Callable[[], dict[str, Any] | None]) -> AsyncIterator[str]:
    """Events of a job until it has ended."""
    last, spoken = None, time.monotonic()
    while True:
        view = await asyncio.to_thread(look)
        if view is None:
            return
        shown = _shown(view)
        if view["state"] in _ENDED:
            yield f"event: {view['state']}\ndata: {json.dumps(shown)}\n\n"
            return
        now = time.monotonic()
        if (view["state"], view["progress"]) != last:
            last, spoken = (view["state"], view["progress"]), now
            yield f"event: progress\ndata: {json.dumps(shown)}\n\n"
        elif now - spoken > _ALIVE:
            spoken = now
            yield ": alive\n\n"
        await asyncio.sleep(_LOOK)


def _shown(view: dict[str, Any]) -> dict[str, Any]:
    """What of a job its client sees."""
    hidden = ("owner", "fingerprint", "result")
    told = {key: value for key, value in view.items() if key not in hidden}
    links = {"self": f"/v1/jobs/{view['id']}", "events": f"/v1/jobs/{view['id']}/events"}
    if view["state"] == "done":
        links["result"] = f"/v1/jobs/{view['id']}/result"
        told["progress"] = {"stage": "done", "share": 1.0}
    return told | {"links": links}


def _told(problem: Problem, metrics: Metrics, instance: str = "") -> JSONResponse:
    metrics.rejected.labels(problem.kind).inc()
    return JSONResponse(problem.document(instance), problem.status, problem.headers, media_type=MEDIA_TYPE)


def _answer_problems(app: FastAPI, metrics: Metrics) -> None:
    """Turn every error into a problem document, and count answers."""

    @app.exception_handler(Problem)
    async def of_problem(request: Request, error: Problem) -> JSONResponse:
        return _told(error, metrics, request.url.path)

    @app.exception_handler(BokehnetError)
    async def of_error(request: Request, error: BokehnetError) -> JSONResponse:
        return _told(problem_of(error), metrics, request.url.path)

    @app.exception_handler(RequestValidationError)
    async def of_validation(request: Request, error: RequestValidationError) -> JSONResponse:
        first = error.errors()[0]
        where = str(first["loc"][-1])
        problem = Problem("request", f"{where}: {first['msg']}", {"parameter": where})
        return _told(problem, metrics, request.url.path)

    @app.exception_handler(HTTPException)
    async def of_http(request: Request, error: HTTPException) -> JSONResponse:
        document = {
            "type": "about:blank",
            "title": error.detail,
            "status": error.status_code,
            "instance": request.url.path,
        }
        return JSONResponse(document, error.status_code, dict(error.headers or {}), media_type=MEDIA_TYPE)

    @app.middleware("http")
    async def count(request: Request, call: Any) -> Response:
        answer: Response = await call(request)
        route = getattr(request.scope.get("route"), "path", "other")
        metrics.requests.labels(request.method, route, answer.status_code).inc()
        return answer
