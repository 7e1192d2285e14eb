"""The application of the service behind Ray Serve, on several machines.

Replicas share the folder of jobs, which must be visible to all machines: each replica answers for every job,
and the others resume the jobs of one that dies. ``serve build bokehnet.serve.ray_app:app`` writes a
configuration; variables ``BOKEHNET_SERVE_FOLDER``, ``_WORKERS``, ``_TOKENS`` and so on are the fields of
:class:`~bokehnet.serve.service_settings.ServiceSettings`.
"""

import os
from collections.abc import Mapping
from typing import Any

from bokehnet.checks import require_extra
from bokehnet.serve.service_settings import ServiceSettings
from bokehnet.settings.fields import field_settings

__all__ = ["application", "settings_from_environment"]

_PREFIX = "BOKEHNET_SERVE_"


def settings_from_environment(variables: Mapping[str, str] = os.environ) -> ServiceSettings:
    """Return the service settings in environment variables.

    Raises:
        ParameterError: A value is out of range.

    Examples:
        >>> settings_from_environment({"BOKEHNET_SERVE_WORKERS": "2"}).workers
        2
    """
    known = field_settings(ServiceSettings)
    texts = {name: variables.get(_PREFIX + name.upper()) for name in known}
    return ServiceSettings(
        **{name: known[name].parsed(text) for name, text in texts.items() if text is not None}
    )


def application(settings: ServiceSettings, replicas: int = 1) -> Any:
    """Return the application for ``ray.serve.run``.

    Args:
        settings: Settings of each replica; ``folder`` must be an absolute path visible to all machines.
        replicas: Initial number; a configuration of Ray Serve can override it, including autoscaling.

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
    if name == "app":  # lazy: importing this module does not require Ray
        return application(settings_from_environment())
    raise AttributeError(name)
