"""Loading of networks and kernels in a background thread."""

import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any

from bokehnet.render.renderer import BokehRenderer
from bokehnet.settings.settings import RenderSettings

__all__ = ["loading_kernels"]


class _NotCompiledYet(Exception):  # noqa: N818 - control flow
    """Raised if a kernel is not in the cache."""


@contextmanager
def loading_kernels(renderer: BokehRenderer, settings: RenderSettings) -> Iterator[None]:
    """Open the networks and load the kernels of a render in a thread while the block runs.

    The thread never compiles: that takes long and cannot be interrupted.
    """
    from numba.core import event

    def load() -> None:
        own_thread = threading.get_ident()

        class Refusal(event.Listener):  # type: ignore[misc]
            def on_start(self, event: Any) -> None:
                if threading.get_ident() == own_thread:
                    raise _NotCompiledYet

            def on_end(self, event: Any) -> None:
                pass

        # The render itself raises any other error.
        with suppress(Exception), event.install_listener("numba:compile", Refusal()):
            renderer.warm_up(settings)

    thread = threading.Thread(target=load, daemon=True)
    thread.start()
    try:
        yield
    finally:
        thread.join()
