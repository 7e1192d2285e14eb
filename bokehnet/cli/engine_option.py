"""The option that picks the engine."""

from typing import Annotated

import typer

__all__ = ["DEFAULT_ENGINE", "Engine"]

DEFAULT_ENGINE = "rays"

Engine = Annotated[
    str, typer.Option(help="rays (sees occlusion), scatter (faster), hybrid or fast (either, with networks).")
]
