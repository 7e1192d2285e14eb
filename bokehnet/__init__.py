"""Bokeh from a picture and its depth: classical, neural and hybrid renderers.

Public names load on first use: importing the package imports neither torch nor onnxruntime. Open first:
:mod:`bokehnet.render`.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from bokehnet.version import __version__ as __version__

if TYPE_CHECKING:  # lazy names for type checkers
    from bokehnet.classical.layered.background.occluded_background import (
        occluded_background as occluded_background,
    )
    from bokehnet.classical.layered.layers import Layers as Layers
    from bokehnet.classical.layered.layers import split_layers as split_layers
    from bokehnet.classical.rays_renderer import rays as rays
    from bokehnet.classical.scatter_renderer import scatter as scatter
    from bokehnet.depth_repair.repair import DisparityRepair as DisparityRepair
    from bokehnet.engines.options import RenderOptions as RenderOptions
    from bokehnet.errors import BokehnetError as BokehnetError
    from bokehnet.io.image import read_image as read_image
    from bokehnet.io.image import write_image as write_image
    from bokehnet.lenses.base import defocus_map as defocus_map
    from bokehnet.lenses.catalog import catalog_names as catalog_names
    from bokehnet.lenses.catalog import load_lens as load_lens
    from bokehnet.lenses.thin import ThinLens as ThinLens
    from bokehnet.optics.aperture import Aperture as Aperture
    from bokehnet.optics.coc import defocus_from_disparity as defocus_from_disparity
    from bokehnet.optics.coc import disparity_from_depth as disparity_from_depth
    from bokehnet.optics.tone import Highlights as Highlights
    from bokehnet.render.renderer import BokehRenderer as BokehRenderer
    from bokehnet.render.result import RenderReport as RenderReport
    from bokehnet.render.result import RenderResult as RenderResult
    from bokehnet.scene.depth.depth_source import ConstantDisparity as ConstantDisparity
    from bokehnet.scene.depth.depth_source import DefocusMap as DefocusMap
    from bokehnet.scene.depth.depth_source import DepthSource as DepthSource
    from bokehnet.scene.depth.depth_source import EmbeddedDepth as EmbeddedDepth
    from bokehnet.scene.depth.depth_source import MetricDepth as MetricDepth
    from bokehnet.scene.depth.depth_source import NetworkDepth as NetworkDepth
    from bokehnet.scene.depth.depth_source import RelativeDisparity as RelativeDisparity
    from bokehnet.scene.scene import FocusedScene as FocusedScene
    from bokehnet.scene.scene import Scene as Scene
    from bokehnet.scene.scene import make_scene as make_scene
    from bokehnet.scene.scene import read_scene as read_scene
    from bokehnet.sequence.sequence import SequenceSettings as SequenceSettings
    from bokehnet.sequence.sequence import make_pull as make_pull
    from bokehnet.sequence.sequence import settings_at_frame as settings_at_frame
    from bokehnet.settings.preset import Preset as Preset
    from bokehnet.settings.preset import load_preset as load_preset
    from bokehnet.settings.preset import presets as presets
    from bokehnet.settings.settings import ApertureSettings as ApertureSettings
    from bokehnet.settings.settings import CameraSettings as CameraSettings
    from bokehnet.settings.settings import ColorSettings as ColorSettings
    from bokehnet.settings.settings import DepthSettings as DepthSettings
    from bokehnet.settings.settings import EffectSettings as EffectSettings
    from bokehnet.settings.settings import EngineSettings as EngineSettings
    from bokehnet.settings.settings import FocusSettings as FocusSettings
    from bokehnet.settings.settings import HighlightSettings as HighlightSettings
    from bokehnet.settings.settings import InputSettings as InputSettings
    from bokehnet.settings.settings import LensSettings as LensSettings
    from bokehnet.settings.settings import LightSettings as LightSettings
    from bokehnet.settings.settings import OutputSettings as OutputSettings
    from bokehnet.settings.settings import RenderSettings as RenderSettings
    from bokehnet.settings.settings_file import load_settings as load_settings
    from bokehnet.settings.settings_file import save_settings as save_settings
    from bokehnet.tools.demo import demo_scene as demo_scene
    from bokehnet.tools.demo import demo_sheet as demo_sheet

_NAMES_BY_MODULE = {
    "bokehnet.classical.layered.background.occluded_background": ("occluded_background",),
    "bokehnet.classical.layered.layers": ("Layers", "split_layers"),
    "bokehnet.classical.rays_renderer": ("rays",),
    "bokehnet.classical.scatter_renderer": ("scatter",),
    "bokehnet.engines.options": ("RenderOptions",),
    "bokehnet.errors": ("BokehnetError",),
    "bokehnet.depth_repair.repair": ("DisparityRepair",),
    "bokehnet.io.image": ("read_image", "write_image"),
    "bokehnet.lenses.base": ("defocus_map",),
    "bokehnet.lenses.catalog": ("catalog_names", "load_lens"),
    "bokehnet.lenses.thin": ("ThinLens",),
    "bokehnet.optics.aperture": ("Aperture",),
    "bokehnet.optics.coc": ("defocus_from_disparity", "disparity_from_depth"),
    "bokehnet.optics.tone": ("Highlights",),
    "bokehnet.tools.demo": ("demo_scene", "demo_sheet"),
    "bokehnet.scene.depth.depth_source": (
        "ConstantDisparity",
        "DefocusMap",
        "DepthSource",
        "EmbeddedDepth",
        "MetricDepth",
        "NetworkDepth",
        "RelativeDisparity",
    ),
    "bokehnet.settings.preset": ("Preset", "load_preset", "presets"),
    "bokehnet.render.renderer": ("BokehRenderer",),
    "bokehnet.render.result": ("RenderReport", "RenderResult"),
    "bokehnet.scene.scene": ("FocusedScene", "Scene", "make_scene", "read_scene"),
    "bokehnet.sequence.sequence": ("SequenceSettings", "make_pull", "settings_at_frame"),
    "bokehnet.settings.settings": (
        "ApertureSettings",
        "CameraSettings",
        "ColorSettings",
        "DepthSettings",
        "EffectSettings",
        "EngineSettings",
        "FocusSettings",
        "HighlightSettings",
        "InputSettings",
        "LensSettings",
        "LightSettings",
        "OutputSettings",
        "RenderSettings",
    ),
    "bokehnet.settings.settings_file": ("load_settings", "save_settings"),
}
_MODULES = {name: module for module, names in _NAMES_BY_MODULE.items() for name in names}

# Names of earlier versions, which still work.
_OLD_NAMES = {"DisparityRefiner": "DisparityRepair", "hidden_layer": "occluded_background"}

__all__ = [
    *_MODULES,
    "__version__",
]


if not TYPE_CHECKING:  # with __getattr__ visible, a type checker would accept any name

    def __getattr__(name: str) -> Any:
        name = _OLD_NAMES.get(name, name)
        if name in _MODULES:
            return getattr(import_module(_MODULES[name]), name)
        raise AttributeError(f"module 'bokehnet' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(__all__)
