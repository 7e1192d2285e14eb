"""The option that picks the engine."""

from typing import Annotated

import typer

__all__ = ["DEFAULT_ENGINE", "RAY_ENGINES", "Engine"]

DEFAULT_ENGINE = "rays"

# Engines that follow rays through a lens: its aberrations, its colours, and discs that lean.
RAY_ENGINES = ("rays", "hybrid")

Engine = Annotated[
    str, typer.Option(help="rays (sees occlusion), scatter (faster), hybrid or fast (either, with networks).")
]
