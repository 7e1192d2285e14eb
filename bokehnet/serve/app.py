"""HTTP interface: jobs, their progress and results, health and metrics."""

import asyncio
import hashlib
import json
import shutil
import time
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from dataclasses import dataclass
from typing import Annotated, Any

from fastapi import Depends, FastAPI, File, Form, Header, Request, Response, UploadFile
from fastapi.exceptions import RequestValidationError
from fastapi.responses import FileResponse, HTMLResponse, JSONResponse, StreamingResponse
from starlette.exceptions import HTTPException

from bokehnet.errors import BokehnetError, ParameterError
from bokehnet.serve.http.docs_page import CONTENT_POLICY, docs_page
from bokehnet.serve.http.tokens import Tokens
from bokehnet.serve.http.uploads import BoundedBody, fetch_url, save_upload
from bokehnet.serve.jobs.pool import Pool
from bokehnet.serve.jobs.store import DamagedJob, JobStore, QueueFull
from bokehnet.serve.metrics import Metrics
from bokehnet.serve.problems import CANCELLED, MEDIA_TYPE, Problem, problem_of
from bokehnet.serve.requests import FORMATS, check_request, file_name
from bokehnet.serve.runnable import check_runnable
from bokehnet.serve.service_settings import ServiceSettings
from bokehnet.version import __version__

__all__ = ["make_app"]

_FINAL_STATES = ("done", "failed", "cancelled")
_POLL_INTERVAL_S, _KEEPALIVE_S = 0.1, 10.0
_RETRY = {"Retry-After": "2"}
_DAMAGED = Problem(
    "damaged", "expected intact files of the job, found damaged ones; they were set aside, send it again"
)


def make_app(settings: ServiceSettings) -> FastAPI:
    """Return the application of a service; its workers start and end with it.

    Args:
        settings: Settings of the service.

    Raises:
        ConfigError: The token file is invalid.
    """
    tokens = Tokens(settings.tokens)
    store = JobStore(settings.folder, settings.queue, settings.keep)
    metrics = Metrics(store.unfinished)
    pool = Pool(store, settings, metrics)

    def admit(headers: dict[bytes, bytes]) -> None:
        """Raise ``Problem`` unless the client is known and there is room for its job."""
        client = tokens.client(headers.get(b"authorization", b"").decode("latin-1"))
        key = headers.get(b"idempotency-key")
        try:
            store.check_room(client, None if key is None else key.decode("latin-1"))
        except QueueFull:
            raise _queue_full(settings) from None

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
        docs_url=None,  # that page would load external scripts; see docs_page.py
        redoc_url=None,
    )
    app.state.pool = pool
    _add_error_handlers(app, metrics)
    app.add_middleware(
        BoundedBody,
        max_bytes=settings.max_upload,
        timeout=settings.patience,
        admit=admit,
        respond=lambda problem: _problem_response(problem, metrics),
    )
    _add_health(app, tokens, metrics, pool)
    _add_docs(app)
    service = _Service(settings=settings, tokens=tokens, store=store, metrics=metrics, pool=pool)
    _add_submission(app, service)
    _add_jobs(app, service)
    return app


def _add_health(app: FastAPI, tokens: Tokens, metrics: Metrics, pool: Pool) -> None:
    @app.get("/healthz", tags=["health"])
    def healthz() -> dict[str, str]:
        """Report that the process responds."""
        return {"status": "ok", "version": __version__}

    @app.get("/readyz", tags=["health"])
    def readyz() -> dict[str, str]:
        """Report whether new jobs are accepted, and rendered."""
        _check_open(pool)
        if not pool.alive:
            raise Problem("draining", "a worker thread has ended; restart the service", headers=_RETRY)
        return {"status": "ready"}

    @app.get("/metrics", tags=["health"])
    def metrics_text(authorization: Annotated[str | None, Header()] = None) -> Response:
        """Return counters in Prometheus' text format."""
        tokens.client(authorization)
        return Response(metrics.text(), media_type="text/plain; version=0.0.4; charset=utf-8")


def _add_docs(app: FastAPI) -> None:
    @app.get("/docs", include_in_schema=False)
    def docs(request: Request) -> HTMLResponse:
        """Return the description of the interface and of all settings."""
        page = docs_page(app.openapi(), str(request.base_url).rstrip("/"))
        return HTMLResponse(page, headers={"Content-Security-Policy": CONTENT_POLICY})


@dataclass(frozen=True, kw_only=True)
class _Service:
    """Settings of a service and the objects that all its routes share."""

    settings: ServiceSettings
    tokens: Tokens
    store: JobStore
    metrics: Metrics
    pool: Pool

    def client(self, authorization: Annotated[str | None, Header()] = None) -> str:
        """Return the client of a request; a dependency of the routes."""
        return self.tokens.client(authorization)

    def owned_job(self, job: str, owner: str) -> dict[str, Any]:
        """Return a job of the client ``owner``; other jobs do not exist for it."""
        view = self.store.view(job)
        if view is None or view["owner"] != owner:
            raise Problem("not-found", f"there is no job {job[:60]}; it may have been removed")
        return view


@dataclass(frozen=True, kw_only=True)
class _Submission:
    """Checked request with its uploads, before they are stored.

    Attributes:
        owner: Client that sent the request.
        request: Checked settings, preset and format.
        uploads: Uploaded file of each field.
        names: Name of the stored file of each field.
        image_url: Address of the picture if it is not among the uploads.
        key: Idempotency key.
    """

    owner: str
    request: dict[str, Any]
    uploads: dict[str, UploadFile]
    names: dict[str, str]
    image_url: str | None
    key: str | None


def _add_submission(app: FastAPI, service: _Service) -> None:
    """Add the route that accepts jobs."""
    Client = Annotated[str, Depends(service.client)]  # noqa: N806  # a type
    Upload = Annotated[UploadFile | None, File()]  # noqa: N806

    @app.post("/v1/jobs", status_code=202, tags=["jobs"])
    def submit(
        owner: Client,
        image: Upload = None,
        disparity: Upload = None,
        depth: Upload = None,
        defocus: Upload = None,
        matte: Upload = None,
        aperture_image: Upload = None,
        image_url: Annotated[str | None, Form()] = None,
        settings_json: Annotated[str, Form(alias="settings")] = "{}",
        preset: Annotated[str | None, Form()] = None,
        output: Annotated[str, Form(alias="format")] = "png",
        idempotency_key: Annotated[str | None, Header(max_length=255)] = None,
    ) -> JSONResponse:
        """Accept a picture, its depth, and settings: a JSON object of groups as in TOML files.

        Repeated requests with the same idempotency key return the same job.
        """
        _check_open(service.pool)
        fields = {"image": image, "disparity": disparity, "depth": depth, "defocus": defocus}
        fields |= {"matte": matte, "aperture_image": aperture_image}
        uploads = {field: file for field, file in fields.items() if file is not None}
        if (image is None) == (image_url is None):
            raise ParameterError("image", "one of `image` and `image_url`", shown="both" if image else "none")
        names = {field: file_name(field, file.filename) for field, file in uploads.items()}
        if image_url is not None:
            names["image"] = file_name("image", image_url.split("?")[0])
        request = check_request(settings_json, preset, output, names)
        return _accept(
            service,
            _Submission(
                owner=owner,
                request=request,
                uploads=uploads,
                names=names,
                image_url=image_url,
                key=idempotency_key,
            ),
        )


def _accept(service: _Service, submission: _Submission) -> JSONResponse:
    """Store a submission as a job, or find the job of its idempotency key; answer with its state."""
    job, new, fingerprint = _store_submission(service, submission)
    view = service.owned_job(job, submission.owner)
    if not new and view["fingerprint"] != fingerprint:
        detail = (
            "Idempotency-Key: expected a new key for each request, found the key of another request; "
            "use a new one"
        )
        raise Problem("idempotency", detail)
    if new:
        service.metrics.accepted.inc()
        service.pool.wake()
    code = 202 if view["state"] not in _FINAL_STATES else 200
    return JSONResponse(_public_view(view), code, {"Location": f"/v1/jobs/{job}"})


def _store_submission(service: _Service, submission: _Submission) -> tuple[str, bool, str]:
    """Save the files of a submission; return its job, whether it is new, and its fingerprint."""
    settings, names = service.settings, submission.names
    incoming = service.store.incoming()
    try:
        hashes = {
            field: save_upload(file.file, incoming / names[field])
            for field, file in submission.uploads.items()
        }
        if submission.image_url is not None:
            hosts, target = settings.fetch_from or (), incoming / names["image"]
            hashes["image"] = fetch_url(
                submission.image_url, hosts, target, settings.max_upload, settings.patience
            )
        check_runnable(submission.request, incoming)
        content = json.dumps([submission.request, hashes], sort_keys=True)
        fingerprint = hashlib.sha256(content.encode()).hexdigest()
        request = submission.request | {
            "owner": submission.owner,
            "fingerprint": fingerprint,
            "hashes": hashes,
            "memory": settings.memory_limit,
        }
        job, new = service.store.submit(incoming, request, submission.key)
    except QueueFull:
        raise _queue_full(settings) from None
    finally:
        shutil.rmtree(incoming, ignore_errors=True)
    return job, new, fingerprint


def _add_jobs(app: FastAPI, service: _Service) -> None:
    """Add the routes of accepted jobs: state, result, events, cancellation."""
    store, owned_job = service.store, service.owned_job
    Client = Annotated[str, Depends(service.client)]  # noqa: N806  # a type

    @app.get("/v1/jobs/{job}", tags=["jobs"])
    def state(job: str, owner: Client) -> dict[str, Any]:
        """Return the state and progress of a job."""
        return _public_view(owned_job(job, owner))

    @app.get("/v1/jobs/{job}/result", tags=["jobs"], response_class=FileResponse)
    def result(job: str, owner: Client) -> Response:
        """Return the rendered picture."""
        view = owned_job(job, owner)
        if view["state"] == "done":
            path = store.result_file(job, view)
            return FileResponse(path, media_type=FORMATS[path.suffix[1:]])
        if view["state"] in _FINAL_STATES:
            document = view.get("problem") or CANCELLED.document()
            return JSONResponse(document, document["status"], media_type=MEDIA_TYPE)
        detail = f"expected a finished job, found state {view['state']}"
        raise Problem("not-done", detail, headers=_RETRY)

    @app.get("/v1/jobs/{job}/events", tags=["jobs"], response_class=StreamingResponse)
    async def events(job: str, owner: Client) -> StreamingResponse:
        """Stream server-sent events: ``progress`` on each change, then one named after the final state."""
        await asyncio.to_thread(owned_job, job, owner)
        return StreamingResponse(
            _events(lambda: store.view(job)),
            media_type="text/event-stream",
            headers={"Cache-Control": "no-store", "X-Accel-Buffering": "no"},
        )

    @app.delete("/v1/jobs/{job}", status_code=204, tags=["jobs"])
    def cancel(job: str, owner: Client) -> Response:
        """Cancel a job, or remove a finished one with its files."""
        if owned_job(job, owner)["state"] in _FINAL_STATES:
            store.remove(job)
        else:
            if store.finish(job, {"state": "cancelled", "problem": CANCELLED.document()}):
                service.metrics.finished.labels("cancelled").inc()
        return Response(status_code=204)


def _queue_full(settings: ServiceSettings) -> Problem:
    detail = f"expected fewer than {settings.queue} unfinished jobs; try again later"
    return Problem("queue-full", detail, headers=dict(_RETRY))


def _check_open(pool: Pool) -> None:
    if pool.draining:
        raise Problem("draining", "the service is stopping; use another one", headers=_RETRY)


async def _events(read: Callable[[], dict[str, Any] | None]) -> AsyncIterator[str]:
    """Yield the events of a job until its final state."""
    last, last_sent = None, time.monotonic()
    while True:
        try:
            view = await asyncio.to_thread(read)
        except DamagedJob:
            failure = {"state": "failed", "problem": _DAMAGED.document()}
            yield f"event: failed\ndata: {json.dumps(failure)}\n\n"
            return
        if view is None:
            return
        public = _public_view(view)
        if view["state"] in _FINAL_STATES:
            yield f"event: {view['state']}\ndata: {json.dumps(public)}\n\n"
            return
        now = time.monotonic()
        if (view["state"], view["progress"]) != last:
            last, last_sent = (view["state"], view["progress"]), now
            yield f"event: progress\ndata: {json.dumps(public)}\n\n"
        elif now - last_sent > _KEEPALIVE_S:
            last_sent = now
            yield ": alive\n\n"
        await asyncio.sleep(_POLL_INTERVAL_S)


def _public_view(view: dict[str, Any]) -> dict[str, Any]:
    """Return the fields of a job that its client may see."""
    hidden = ("owner", "fingerprint", "result", "result_sha256")
    public = {key: value for key, value in view.items() if key not in hidden}
    links = {"self": f"/v1/jobs/{view['id']}", "events": f"/v1/jobs/{view['id']}/events"}
    if view["state"] == "done":
        links["result"] = f"/v1/jobs/{view['id']}/result"
        public["progress"] = {"stage": "done", "share": 1.0}
    return public | {"links": links}


def _problem_response(problem: Problem, metrics: Metrics, instance: str = "") -> JSONResponse:
    metrics.rejected.labels(problem.kind).inc()
    return JSONResponse(problem.document(instance), problem.status, problem.headers, media_type=MEDIA_TYPE)


def _add_error_handlers(app: FastAPI, metrics: Metrics) -> None:
    """Convert every error into a problem document, and count responses."""

    @app.exception_handler(Problem)
    async def of_problem(request: Request, error: Problem) -> JSONResponse:
        return _problem_response(error, metrics, request.url.path)

    @app.exception_handler(DamagedJob)
    async def of_damage(request: Request, error: DamagedJob) -> JSONResponse:
        return _problem_response(_DAMAGED, metrics, request.url.path)

    @app.exception_handler(BokehnetError)
    async def of_error(request: Request, error: BokehnetError) -> JSONResponse:
        return _problem_response(problem_of(error), metrics, request.url.path)

    @app.exception_handler(RequestValidationError)
    async def of_validation(request: Request, error: RequestValidationError) -> JSONResponse:
        first = error.errors()[0]
        parameter = str(first["loc"][-1])
        problem = Problem("request", f"{parameter}: {first['msg']}", {"parameter": parameter})
        return _problem_response(problem, metrics, request.url.path)

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
        response: Response = await call(request)
        route = getattr(request.scope.get("route"), "path", "other")
        metrics.requests.labels(request.method, route, response.status_code).inc()
        return response
