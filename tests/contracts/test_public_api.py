"""Guarantees to users: the public names, the layers, and a package that renders without torch."""

import subprocess
import sys
from importlib import import_module

import numpy as np
import pytest

import bokehnet
from bokehnet import errors

PUBLIC = [
    "Aperture",
    "ApertureSettings",
    "BokehRenderer",
    "BokehnetError",
    "CameraSettings",
    "ColorSettings",
    "ConstantDisparity",
    "DefocusMap",
    "DepthSettings",
    "DepthSource",
    "DisparityRepair",
    "EffectSettings",
    "EmbeddedDepth",
    "EngineSettings",
    "FocusSettings",
    "FocusedScene",
    "HighlightSettings",
    "Highlights",
    "InputSettings",
    "Layers",
    "LensSettings",
    "LightSettings",
    "MetricDepth",
    "NetworkDepth",
    "OutputSettings",
    "Preset",
    "RelativeDisparity",
    "RenderOptions",
    "RenderReport",
    "RenderResult",
    "RenderSettings",
    "Scene",
    "SequenceSettings",
    "ThinLens",
    "__version__",
    "as_image",
    "catalog_names",
    "defocus_from_disparity",
    "defocus_map",
    "demo_scene",
    "demo_sheet",
    "disparity_from_depth",
    "load_lens",
    "load_preset",
    "load_settings",
    "make_pull",
    "make_scene",
    "occluded_background",
    "presets",
    "rays",
    "read_image",
    "read_scene",
    "save_settings",
    "scatter",
    "settings_at_frame",
    "split_layers",
    "write_image",
]

# Imported before anything else, it makes every `import torch` fail as on a machine without torch.
NO_TORCH = """
import sys
class Barrier:
    def find_spec(self, name, path=None, target=None):
        if name.split('.')[0] in ('torch', 'kornia', 'skimage', 'scipy'):
            raise ModuleNotFoundError(f'No module named {name!r}', name=name)
sys.meta_path.insert(0, Barrier())
"""


def run_python(code: str) -> subprocess.CompletedProcess:
    return subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=300)


def test_public_names_are_pinned_and_exist():
    assert sorted(bokehnet.__all__) == PUBLIC
    for name in bokehnet.__all__:
        assert getattr(bokehnet, name) is not None
    with pytest.raises(AttributeError, match="no attribute 'nonsense'"):
        _ = bokehnet.nonsense


def test_old_public_names_still_work_but_are_not_offered():
    assert bokehnet.hidden_layer is bokehnet.occluded_background
    assert bokehnet.DisparityRefiner is bokehnet.DisparityRepair
    assert not set(bokehnet._OLD_NAMES) & set(bokehnet.__all__)


TORCH_ROOMS = (
    "bokehnet.classical.torch",
    "bokehnet.models",
    "bokehnet.raytrace",
    "bokehnet.synth",
    "bokehnet.torch",
)


@pytest.mark.parametrize(
    "module",
    [
        "bokehnet.inference.coarse_to_fine",
        "bokehnet.checks",
        "bokehnet.classical.torch.autograd",
        "bokehnet.classical.base",
        "bokehnet.classical.error_map",
        "bokehnet.classical.scatter.disc_scatter",
        "bokehnet.classical.rays_renderer",
        "bokehnet.classical.scatter_renderer",
        "bokehnet.config",
        "bokehnet.errors",
        "bokehnet.engines.engine",
        "bokehnet.inference.session",
        "bokehnet.io.image",
        "bokehnet.io.maps",
        "bokehnet.lenses",
        "bokehnet.models.arnet",
        "bokehnet.models.checkpoint",
        "bokehnet.models.iunet",
        "bokehnet.optics.aperture",
        "bokehnet.optics.coc",
        "bokehnet.optics.sampling",
        "bokehnet.optics.tone",
        "bokehnet.arrays.pyramid",
        "bokehnet.raytrace",
        "bokehnet.synth.shards",
        "bokehnet.torch",
        "bokehnet.torch.occlusion",
    ],
)
def test_every_name_in_all_exists(module):
    if module.startswith(TORCH_ROOMS):
        pytest.importorskip("torch", reason="a room that needs the extra train")
    loaded = import_module(module)
    for name in loaded.__all__:
        assert hasattr(loaded, name)


def test_every_error_is_a_bokehnet_error():
    classes = [getattr(errors, name) for name in errors.__all__]
    raised = [kind for kind in classes if isinstance(kind, type) and issubclass(kind, BaseException)]
    assert len(raised) >= 10
    assert all(issubclass(kind, errors.BokehnetError) for kind in raised)


@pytest.mark.slow
def test_importing_the_package_imports_neither_torch_nor_onnxruntime():
    code = "import sys, bokehnet; print([m for m in ('torch', 'onnxruntime', 'numpy') if m in sys.modules])"
    assert run_python(code).stdout.strip() == "[]"


@pytest.mark.slow
@pytest.mark.parametrize("engine", ["hybrid", "fast", "rays"])
def test_a_render_never_needs_torch(engine):
    code = NO_TORCH + (
        "import numpy as np, bokehnet\n"
        "image = np.random.default_rng(0).random((40, 50, 3), dtype=np.float32)\n"
        "defocus = np.where(np.arange(50) < 20, 8, -1).astype(np.float32)[None].repeat(40, 0)\n"
        "defocus = bokehnet.DisparityRepair()(image, defocus)\n"
        f"result = bokehnet.BokehRenderer('{engine}').render_arrays(image, defocus)\n"
        f"assert (result.neural is None) == ('{engine}' == 'rays') and np.isfinite(result.bokeh).all()\n"
        "assert 'torch' not in sys.modules\n"
        "print('rendered', result.bokeh.shape)\n"
    )
    done = run_python(code)
    assert done.stdout.strip() == "rendered (40, 50, 3)", done.stderr


@pytest.mark.slow
@pytest.mark.parametrize(
    ("module", "extra"),
    [("bokehnet.models", "train"), ("bokehnet.raytrace", "trace"), ("bokehnet.scenes", "trace")],
)
def test_a_package_that_needs_torch_names_the_extra(module, extra):
    done = run_python(NO_TORCH + f"import {module}")
    assert f"pip install 'bokehnet[{extra}]'" in done.stderr
    assert "MissingExtraError" in done.stderr


def test_results_are_arrays_of_the_documented_shape():
    image = np.full((20, 30, 3), 0.5, np.float32)
    result = bokehnet.BokehRenderer("scatter").render_arrays(image, np.zeros((20, 30), np.float32))
    assert result.bokeh.shape == (20, 30, 3)
    assert result.bokeh.dtype == np.float32
    assert result.error_map.shape == (20, 30)
    assert result.neural is None
