"""The same application behind Ray Serve, on more than one machine.

Replicas share the folder of jobs, which must be one that all machines see: any of them answers for any job,
and the jobs of one that dies are taken by the others. ``serve build bokehnet.serve.ray_app:app`` writes a
configuration; variables ``BOKEHNET_SERVE_FOLDER``, ``_WORKERS``, ``_TOKENS`` and so on are the fields of
:class:`~bokehnet.serve.service_settings.ServiceSettings`.
"""

import os
from collections.abc import Mapping
from typing import Any

from bokehnet.checks import require_extra
from bokehnet.serve.service_settings import ServiceSettings
from bokehnet.settings.fields import field_settings

__all__ = ["application", "settings_of_environment"]

_PREFIX = "BOKEHNET_SERVE_"


def settings_of_environment(variables: Mapping[str, str] = os.environ) -> ServiceSettings:
    """Return what the variables of a process say.

    Raises:
        ParameterError: A value is out of range.

    Examples:
        >>> settings_of_environment({"BOKEHNET_SERVE_WORKERS": "2"}).workers
        2
    """
    known = field_settings(ServiceSettings)
    said = {name: variables.get(_PREFIX + name.upper()) for name in known}
    return ServiceSettings(
        **{name: known[name].parsed(text) for name, text in said.items() if text is not None}
    )


def application(settings: ServiceSettings, replicas: int = 1) -> Any:
    """Return the application for ``ray.serve.run``.

    Args:
        settings: Of each replica; ``folder`` must be an absolute path that all machines see.
        replicas: How many begin; a configuration of Ray Serve can say more, autoscaling too.

    Raises:
        MissingExtraError: Ray Serve is not installed.
    """
    require_extra("ray.serve", "serve-cluster")
    from ray import serve

    def build() -> Any:
        from bokehnet.serve.app import make_app

        return make_app(settings)

    deployment = serve.deployment(
        num_replicas=replicas,
        max_ongoing_requests=64,
        graceful_shutdown_timeout_s=settings.drain + 10,
        ray_actor_options={"num_cpus": max(1, settings.workers)},
        name="bokehnet",
    )
    return deployment(serve.ingress(build)()).bind()


def __getattr__(name: str) -> Any:
    if name == "app":  # made when it is asked for: importing this module needs no Ray
        return application(settings_of_environment())
    raise AttributeError(name)
