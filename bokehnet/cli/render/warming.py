"""Opening networks and loading kernels while something else is done."""

import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any

from bokehnet.render.renderer import BokehRenderer
from bokehnet.settings.settings import RenderSettings

__all__ = ["loading_kernels"]


class _NotCompiledYet(Exception):  # noqa: N818 - it is no error
    """A kernel is not in the cache."""


@contextmanager
def loading_kernels(renderer: BokehRenderer, settings: RenderSettings) -> Iterator[None]:
    """Open the networks and load the kernels that a rendering needs, in a thread, while the block runs.

    Nothing is compiled there: that takes long, and could not be interrupted.
    """
    from numba.core import event

    def load() -> None:
        mine = threading.get_ident()

        class Refusal(event.Listener):  # type: ignore[misc]
            def on_start(self, event: Any) -> None:
                if threading.get_ident() == mine:
                    raise _NotCompiledYet

            def on_end(self, event: Any) -> None:
                pass

        # What is wrong otherwise is told by the picture itself.
        with suppress(Exception), event.install_listener("numba:compile", Refusal()):
            renderer.warm_up(settings)

    thread = threading.Thread(target=load, daemon=True)
    thread.start()
    try:
        yield
    finally:
        thread.join()
