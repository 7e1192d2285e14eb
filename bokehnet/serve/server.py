"""The service in one process: uvicorn with a graceful shutdown."""

import ipaddress
import os
import signal
import threading
from types import FrameType

from bokehnet.checks import require_extra
from bokehnet.errors import ParameterError
from bokehnet.serve.http.connections import MAX_CONNECTIONS, REQUEST_SECONDS, bounded_protocol
from bokehnet.serve.service_settings import ServiceSettings

__all__ = ["run_service"]


def run_service(settings: ServiceSettings) -> None:
    """Serve until SIGTERM or Ctrl-C; then finish running jobs and leave the others in the queue.

    Raises:
        MissingExtraError: The extra "serve" is not installed.
        ParameterError: Other machines can connect, and no tokens are set.
        ConfigError: The token file is invalid.
    """
    for module in ("fastapi", "uvicorn", "prometheus_client", "python_multipart"):
        require_extra(module, "serve")
    if settings.tokens is None and not _is_local(settings.host):
        raise ParameterError(
            "serve.tokens", f"a file, since {settings.host} is open to other machines", shown="none"
        )
    import uvicorn
    from uvicorn.protocols.http.auto import AutoHTTPProtocol

    from bokehnet.serve.app import make_app

    app = make_app(settings)

    class Server(uvicorn.Server):
        """Server that drains before it closes its socket, so that clients can still fetch results."""

        def handle_exit(self, sig: int, frame: FrameType | None) -> None:
            if app.state.pool.draining or sig == signal.SIGINT:
                super().handle_exit(sig, frame)
                return
            app.state.pool.draining = True

            def end() -> None:
                app.state.pool.drain(settings.drain)
                super(Server, self).handle_exit(sig, frame)

            threading.Thread(target=end, daemon=True).start()

    os.umask(0o077)  # jobs are private to the user of the service
    protocol = bounded_protocol(AutoHTTPProtocol, MAX_CONNECTIONS, REQUEST_SECONDS)
    config = uvicorn.Config(
        app,
        settings.host,
        settings.port,
        http=protocol,
        ws="none",
        log_level="info",
        timeout_graceful_shutdown=10,
    )
    Server(config).run()


def _is_local(host: str) -> bool:
    """Return whether an address belongs to this machine only."""
    try:
        return ipaddress.ip_address(host.strip("[]")).is_loopback
    except ValueError:
        return host == "localhost"
