"""``bokehnet serve``: rendering as a service."""

import click

from bokehnet.cli.options import OptionValues, with_options
from bokehnet.cli.parser import SectionedCommand
from bokehnet.serve.service_settings import ServiceSettings

__all__ = ["serve"]


@click.command(cls=SectionedCommand)
@with_options([ServiceSettings])
def serve(*, option_values: OptionValues) -> None:
    """Run a render service over HTTP.

    Clients POST to /v1/jobs; /openapi.json describes the API.
    """
    from bokehnet.errors import ParameterError
    from bokehnet.serve.server import run_service  # after parsing, so that --help stays fast

    try:
        run_service(ServiceSettings(**option_values.get("serve", {})))
    except ParameterError as error:
        known = error.parameter.removeprefix("serve.")
        raise error.renamed(f"--{known.replace('_', '-')}") from error
