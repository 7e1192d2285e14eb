"""Complete renderer as one graph, and its comparison with the renderer of the package."""

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import onnx

from bokehnet.arrays.fusion import fuse
from bokehnet.baselines.spread.bokehme import bokehme
from bokehnet.checks import check_choice
from bokehnet.engine_registry import ENGINES
from bokehnet.engines.engine import Engine
from bokehnet.engines.options import RenderOptions
from bokehnet.errors import ModelFileError, ParameterError
from bokehnet.inference.bokehme import DISPLAY_GAMMA
from bokehnet.inference.session import WEIGHTS, load_networks
from bokehnet.io.files.atomic import write_bytes
from bokehnet.onnx_file.bokehme import build_bokehme
from bokehnet.onnx_file.builder import OPSET, Graph, Value
from bokehnet.onnx_file.error_map import geometric_error_map
from bokehnet.onnx_file.neural import render_neural
from bokehnet.onnx_file.occlusion.layers import split_layers
from bokehnet.onnx_file.occlusion.rays import render_rays
from bokehnet.onnx_file.polygon import Polygon, read_polygon
from bokehnet.onnx_file.scatter import scatter_beyond
from bokehnet.onnx_file.tone import gamma_curve
from bokehnet.onnx_session import OnnxSession
from bokehnet.optics.coc import defocus_from_disparity
from bokehnet.progress import Progress, ignore_progress
from bokehnet.version import __version__

__all__ = ["ONE_FILE_ENGINES", "PARITY", "RAYS_PARITY", "build_model", "export_renderer"]

# Engines, and the baseline that has a file for comparisons.
BASELINE = "bokehme"
ONE_FILE_ENGINES = (*(name for name, spec in ENGINES.items() if spec.one_file), BASELINE)

# Largest blur in pixels with which that file is compared; its scatter has a step for each offset of a disc.
_MAX_BASELINE_BLUR_PX = 10.0

# Minimum PSNR in dB, of scene-linear light with white as the peak, between the file and the package. The file
# of the rays estimates layers in a simpler form (:mod:`bokehnet.onnx_file.occlusion.layers`).
PARITY, RAYS_PARITY = 50.0, 30.0

# Heights, widths, blurs and gammas of the comparison: no side is a multiple of a block, one picture
# has more rows than a block, one a blur beyond all tables.
_TRIALS = ((97, 131, 9.0, 1.0), (301, 154, 30.0, 1.0), (150, 203, 220.0, 1.0), (120, 90, 20.0, 2.2))


@dataclass(frozen=True, kw_only=True, slots=True)
class _Networks:
    """Networks for the file; the largest radii, pixels, in their training and that they may correct."""

    arnet: onnx.ModelProto
    iunet: onnx.ModelProto | None
    network_max_radius: float
    max_valid_radius: float


def _read_networks(weights: Path, engine: str) -> _Networks:
    """Return the checked networks of a folder that the engine uses."""
    networks = load_networks(weights, "scatter", threads=1, refine=ENGINES[engine].refines)
    entries = json.loads((weights / "manifest.json").read_text(encoding="utf-8"))["networks"]

    def read(name: str) -> onnx.ModelProto:
        path = weights / entries[name]["file"]
        network = onnx.load(path)
        versions = {item.domain: item.version for item in network.opset_import}
        if versions != {"": OPSET}:
            raise ModelFileError(f"{path}: expected operator set {OPSET}, found {versions}; export again")
        return network

    return _Networks(
        arnet=read("arnet"),
        iunet=None if networks.iunet is None else read("iunet"),
        network_max_radius=networks.network_max_radius,
        max_valid_radius=networks.max_valid_radius,
    )


def build_model(weights: Path | None = None, engine: str = "fast") -> onnx.ModelProto:
    """Return an engine as one ONNX model of standard operators.

    Inputs, all float32: ``image`` (H, W, 3), scene-linear; ``disparity`` (H, W), near is large; ``K``,
    ``focus`` and ``gamma``, each of shape (). Blur in pixels is ``K * (disparity - focus)``. Output:
    ``bokeh`` (H, W, 3), scene-linear. The networks support only gamma 1; with any other the result is that of
    the engine ``scatter``. The rays support any gamma. It is clipped to 0.2 to 5. The rays have optional
    inputs: for a known occluded background ``background`` (H, W, 3) and ``background_disparity`` (H, W); for
    the aperture ``aperture`` (n, 2), the corners of a convex polygon in order, right and down in blur radii.

    Args:
        weights: Folder with the networks and their manifest; default: those of the engine. Not for ``rays``.
        engine: ``"fast"``, ``"neural"``, ``"rays"``, or the baseline ``"bokehme"``.

    Raises:
        ParameterError: Another engine, or weights for an engine without networks.
        ModelFileError: A network is missing or damaged, or does not correct the scatter.
    """
    check_choice("engine", engine, ONE_FILE_ENGINES)
    if engine == BASELINE:
        folder = weights or WEIGHTS / BASELINE
        return build_bokehme(*(onnx.load(folder / f"bokehme_{name}.onnx") for name in ("arnet", "iunet")))
    traces_rays = ENGINES[engine].traces_rays
    networks = None
    if traces_rays and weights is not None:
        raise ParameterError(
            "weights", f"none for engine {engine}", shown=str(weights), remedy="use engine fast"
        )
    if not traces_rays:
        networks = _read_networks(weights or WEIGHTS / str(ENGINES[engine].networks), engine)
    g = Graph()
    image = g.input("image", np.float32, ["height", "width", 3])
    disparity = g.input("disparity", np.float32, ["height", "width"])
    blur, focus, gamma = (g.input(name, np.float32, []) for name in ("K", "focus", "gamma"))
    image = g.maximum(image, 0).transpose(2, 0, 1)
    defocus = defocus_from_disparity(disparity, blur, focus)
    linear = gamma.reshape(1).equals(1)

    encoded = g.branch(linear, lambda: image, lambda: gamma_curve(g, image, gamma).encode(image))
    polygon = None
    if traces_rays:
        polygon = read_polygon(g, g.optional_input("aperture", np.zeros((0, 2), np.float32), ["corners", 2]))
    blurred = scatter_beyond(g, encoded, defocus, polygon)
    if polygon is not None:
        shape = ["background_height", "background_width"]
        colors = g.optional_input("background", np.zeros((0, 0, 3), np.float32), [*shape, 3])
        behind = g.optional_input("background_disparity", np.zeros((0, 0), np.float32), shape)
        background = colors, defocus_from_disparity(behind, blur, focus)
        blurred = _traced(g, image, defocus, blurred, gamma, background, polygon)
    classical = g.branch(linear, lambda: blurred, lambda: gamma_curve(g, image, gamma).decode(blurred))

    def corrected() -> Value:
        if networks is None:
            return classical
        classical_error_map = geometric_error_map(g, defocus)
        return render_neural(
            g,
            image,
            defocus,
            classical,
            classical_error_map,
            arnet=networks.arnet,
            iunet=networks.iunet,
            network_max_radius=networks.network_max_radius,
            max_valid_radius=networks.max_valid_radius,
        )

    bokeh = g.branch(linear, corrected, lambda: classical).transpose(1, 2, 0)
    about = {"producer": f"bokehnet {__version__}", "license": "Apache-2.0", "light": "scene-linear"}
    model = g.model({"bokeh": (bokeh, ["height", "width", 3])}, **about)
    onnx.checker.check_model(model, full_check=True)
    return model


def _traced(
    g: Graph,
    image: Value,
    defocus: Value,
    smooth: Value,
    gamma: Value,
    background: tuple[Value, Value],
    polygon: Polygon,
) -> Value:
    """Blend the rays through the layers of a picture with its scatter ``smooth``, both of encoded light."""
    linear = gamma.reshape(1).equals(1)
    error_map = geometric_error_map(g, defocus)

    def encode(colors: Value) -> Value:
        return g.branch(linear, lambda: colors, lambda: gamma_curve(g, image, gamma).encode(colors))

    def blended() -> Value:
        layers = split_layers(g, image, defocus, background)
        first, second = (encode(colors) for colors in layers.colors)
        rays = render_rays(g, layers._replace(colors=(first, second)), error_map, polygon)
        return fuse(smooth, rays, error_map.reshape(1, defocus.size(0), defocus.size(1)))

    return g.branch(error_map.max() > 0, blended, lambda: smooth)


def _trial_picture(height: int, width: int) -> tuple[np.ndarray, np.ndarray]:
    """Return a colored texture of all frequencies, and a disparity of slopes and steps in [0, 1]."""
    rng = np.random.default_rng(height)
    y, x = np.mgrid[:height, :width].astype(np.float32)
    image = np.zeros((height, width, 3), np.float32)
    for size in (2, 8, 32):
        cells = rng.random((height // size + 1, width // size + 1, 3), dtype=np.float32) / 3
        image += cells.repeat(size, 0).repeat(size, 1)[:height, :width]
    disparity = 0.3 * y / height
    for _ in range(6):
        inside = (
            np.hypot(y - rng.uniform(0, height), x - rng.uniform(0, width)) < rng.uniform(0.05, 0.2) * width
        )
        disparity = np.where(inside, np.float32(rng.random()), disparity)
    return image, disparity


def _compare(model: bytes, weights: Path | None, engine: str, progress: Progress | None) -> list[float]:
    """Return the PSNR in dB between a file's content in ONNX Runtime and the package, one per trial."""
    if engine == BASELINE:
        return _compare_baseline(model)
    report = progress or ignore_progress
    session = OnnxSession(model, options={"log_severity_level": 3})
    hybrid, plain = Engine(engine, weights=weights), Engine("scatter")
    psnrs: list[float] = []
    for height, width, blur, gamma in _TRIALS:
        report(len(psnrs), len(_TRIALS))
        image, disparity = _trial_picture(height, width)
        focus = float(np.median(disparity))
        numbers = {"K": blur, "focus": focus, "gamma": gamma}
        scalars = {name: np.array(number, np.float32) for name, number in numbers.items()}
        rendered = session.run({"image": image, "disparity": disparity, **scalars})[0]
        defocus = defocus_from_disparity(disparity, np.float32(blur), np.float32(focus))
        package = hybrid if gamma == 1 or ENGINES[engine].traces_rays else plain
        expected = package.render(image, defocus, options=RenderOptions(gamma=gamma)).bokeh
        psnrs.append(float(-10 * np.log10(np.square(rendered - expected).mean() + 1e-20)))
    report(len(psnrs), len(_TRIALS))
    return psnrs


def _compare_baseline(model: bytes) -> list[float]:
    """Return the PSNR in dB between the baseline's file and its function, one per trial."""
    session, psnrs = OnnxSession(model, options={"log_severity_level": 3}), []
    for height, width, blur, gamma in _TRIALS:
        image, disparity = _trial_picture(height, width)
        blur = min(blur, _MAX_BASELINE_BLUR_PX)
        numbers = {"K": blur, "focus": 0.0, "gamma": gamma}
        scalars = {name: np.array(number, np.float32) for name, number in numbers.items()}
        rendered = session.run({"image": image, "disparity": disparity, **scalars})[0]
        expected = bokehme(image, np.float32(blur) * disparity, gamma=min(DISPLAY_GAMMA * gamma, 5.0))
        psnrs.append(float(-10 * np.log10(np.square(rendered - expected).mean() + 1e-20)))
    return psnrs


def export_renderer(
    path: Path,
    weights: Path | None = None,
    progress: Progress | None = None,
    *,
    engine: str = "fast",
) -> float:
    """Write an engine as one ONNX file, after a check that it renders the same as the package.

    Args:
        path: Output file.
        weights: See :func:`build_model`.
        progress: Callback that receives (completed trials, total trials).
        engine: See :func:`build_model`.

    Returns:
        Lowest PSNR of the trials, dB.

    Raises:
        ParameterError: See :func:`build_model`.
        ModelFileError: See :func:`build_model`; or a PSNR is below ``PARITY``, ``RAYS_PARITY`` for the rays,
            or the file cannot be written; an older file is kept.
    """
    content = build_model(weights, engine).SerializeToString()
    lowest = min(_compare(content, weights, engine, progress))
    required = RAYS_PARITY if engine in ENGINES and ENGINES[engine].traces_rays else PARITY
    if not lowest >= required:
        raise ModelFileError(
            f"{path}: expected at least {required:g} dB between the file and the package, "
            f"found {lowest:.1f}; not written"
        )
    write_bytes(path, content, error=ModelFileError)
    return lowest
