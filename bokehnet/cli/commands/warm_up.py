"""``bokehnet warm-up``: compile what rendering needs before it is needed, as in the image of a container."""

from typing import Annotated, Any

import typer

__all__ = ["warm_up"]

# Settings whose kernels differ: one for each thing that a lens, an opening or an engine may add.
_NEURAL = ("hybrid", "fast", "neural")
_PLAIN: tuple[dict[str, Any], ...] = ({}, *({"engine": {"name": name}} for name in _NEURAL))
_LOOKS: tuple[dict[str, Any], ...] = (
    {"aperture": {"blades": 6}},
    {"aperture": {"blades": 6, "cats_eye": 0.5}},
    {"aperture": {"cats_eye": 0.5}},
    {"color": {"axial": 0.4}},
    {"lens": {"name": "double_gauss"}},
    {"lens": {"spherical": 0.5}},
    {"effects": {"grain": 1600.0}},
)


def warm_up(
    everything: Annotated[
        bool, typer.Option("--all", help="Also what shapes of the opening, lenses, fringes and grain need.")
    ] = False,
) -> None:
    """Compile what rendering needs, once for this machine, and render small pictures with it."""
    from bokehnet.cli.progress import compile_notice, progress  # after parsing, so --help stays fast
    from bokehnet.precompiled.kernel import KERNELS
    from bokehnet.render.renderer import BokehRenderer
    from bokehnet.tools.demo import demo_settings, small_demo_scene

    looks = (*_PLAIN, *(_LOOKS if everything else ()))
    renderer, scene = BokehRenderer(), small_demo_scene()
    with compile_notice(), progress("warming up") as report:
        for done, look in enumerate(looks):
            report(done, len(looks))
            renderer.render(scene, demo_settings("middle").updated(look))
        report(len(looks), len(looks))
    found = [run for kernel in KERNELS.values() for run in kernel.machine_code.values()]
    ready = sum(run is not None for run in found)
    typer.echo(f"ready: {ready} kernels came with the package, {len(found) - ready} are compiled by numba")
