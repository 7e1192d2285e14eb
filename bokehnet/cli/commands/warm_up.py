"""``bokehnet warm-up``: compilation of kernels in advance, e.g. in a container image."""

from typing import Any

import click

from bokehnet.cli.parser import SectionedCommand

__all__ = ["warm_up"]

# Settings with different kernels: one per feature of a lens, an aperture or an engine.
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


@click.command(cls=SectionedCommand)
@click.option(
    "everything", "--all", is_flag=True, help="Also compile for aperture shapes, lenses, fringes and grain."
)
def warm_up(
    everything: bool,
) -> None:
    """Compile all kernels of a render once for this machine.

    Renders small pictures.
    """
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
    variants = [code for kernel in KERNELS.values() for code in kernel.machine_code.values()]
    shipped = sum(code is not None for code in variants)
    click.echo(f"ready: {shipped} kernels shipped precompiled, {len(variants) - shipped} compiled by numba")
