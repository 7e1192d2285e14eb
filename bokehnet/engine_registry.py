"""Registry of engines: every fact about an engine that more than one part of the package needs.

A new engine is one row here, plus its module. The command line, the settings, memory bounds, strips, the
one-file export and the help read these rows. Methods of the literature, for comparison only, are in
:mod:`bokehnet.baselines`.
"""

from dataclasses import dataclass, replace

__all__ = ["CLASSICAL", "DEFAULT_ENGINE", "ENGINES", "RAY_ENGINES", "EngineSpec"]


@dataclass(frozen=True, kw_only=True, slots=True)
class EngineSpec:
    """Facts about one engine.

    Attributes:
        name: Name for users.
        about: Short description for help texts.
        classical: Name of the engine that renders the classical half; its own name if it has
            no networks.
        renderer: Function of the classical half, "module:function".
        networks: Folder of its networks in ``bokehnet/weights``; ``None`` for a classical engine.
        refines: Whether IUNet leads the correction up to full size; without it the classical detail is kept.
        traces_rays: Whether pupil rays are traced, so that aberrations, colour fringes and occluded
            surfaces are rendered.
        sharp_foregrounds: Whether the classical half leaves sharp outlines on blurred foregrounds, which the
            correction has to suppress (by
            :func:`bokehnet.inference.coarse_to_fine.suppress_foreground_outlines`).
        bytes_per_pixel: Peak memory of a strip per pixel that its light or rays can reach, beyond input and
            output of the picture, bytes.
        halo_bytes_per_pixel: The same per pixel that is read, which includes what the occluded background of
            the others is estimated from, bytes.
        in_strips: Whether large pictures can be rendered in strips under ``max_memory``.
        one_file: Whether ``bokehnet export`` can write it as one ONNX file.
    """

    name: str
    about: str
    classical: str
    renderer: str
    networks: str | None = None
    refines: bool = True
    traces_rays: bool = False
    sharp_foregrounds: bool = False
    bytes_per_pixel: int
    halo_bytes_per_pixel: int = 0
    in_strips: bool = True
    one_file: bool = False


_RAYS = EngineSpec(
    name="rays",
    about="rays traced from the pupil through layers",
    classical="rays",
    renderer="bokehnet.classical.rays_renderer:render_rays",
    traces_rays=True,
    bytes_per_pixel=96,
    halo_bytes_per_pixel=60,
    one_file=True,
)
_SCATTER = EngineSpec(
    name="scatter",
    about="every pixel spread over its disc, without occlusion, fastest",
    classical="scatter",
    renderer="bokehnet.classical.scatter_renderer:render_scatter",
    sharp_foregrounds=True,
    bytes_per_pixel=45,
)

ENGINES: dict[str, EngineSpec] = {
    spec.name: spec
    for spec in (
        _RAYS,
        _SCATTER,
        replace(
            _RAYS, name="hybrid", about="rays, corrected by a network", networks="hybrid", one_file=False
        ),
        replace(
            _SCATTER,
            name="neural",
            about="scatter, corrected by ARNet and IUNet",
            networks="neural",
            in_strips=False,
            one_file=True,
        ),
        replace(
            _SCATTER,
            name="fast",
            about="scatter, corrected by ARNet",
            networks="neural",
            refines=False,
            one_file=True,
        ),
    )
}

CLASSICAL: dict[str, EngineSpec] = {name: spec for name, spec in ENGINES.items() if spec.networks is None}

RAY_ENGINES = tuple(name for name, spec in ENGINES.items() if spec.traces_rays)

DEFAULT_ENGINE = "rays"
