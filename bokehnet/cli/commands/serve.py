"""``bokehnet serve``: rendering as a service."""

from bokehnet.cli.options import Given, with_options
from bokehnet.serve.service_settings import ServiceSettings

__all__ = ["serve"]


@with_options([ServiceSettings])
def serve(*, given: Given) -> None:
    """Serve renderings by HTTP: POST /v1/jobs; its description is at /openapi.json."""
    from bokehnet.errors import ParameterError
    from bokehnet.serve.server import run_service  # after parsing, so that --help stays fast

    try:
        run_service(ServiceSettings(**given.get("serve", {})))
    except ParameterError as error:
        known = error.parameter.removeprefix("serve.")
        raise error.renamed(f"--{known.replace('_', '-')}") from error
