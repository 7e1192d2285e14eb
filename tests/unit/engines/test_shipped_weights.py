"""Quality of the networks that ship with the package."""

import numpy as np
import pytest

from bokehnet.classical.error_map import geometric_error_map
from bokehnet.classical.rays_renderer import rays
from bokehnet.config import load_config
from bokehnet.depth_repair.repair import DisparityRepair
from bokehnet.inference import process_memory as memory
from bokehnet.inference.session import WEIGHTS, load_network
from bokehnet.models.error import FEATURES
from bokehnet.optics.coc import defocus_from_disparity
from bokehnet.render.renderer import BokehRenderer
from bokehnet.synth import SynthConfig
from bokehnet.synth.pairs import make_sample
from tests.conftest import ROOT
from train.scores.metrics import compare, mean_scores

# Minimum gain of each engine over its classical render, dB.
GAIN = {"hybrid": 0.1, "fast": 1.0, "neural": 1.0}

HELD_OUT = {"seed": 77, "width": 160, "height": 160, "views": 2, "defocus": [4.0, 14.0]}


@pytest.fixture(scope="module")
def samples():
    """Return three held-out scenes."""
    overrides = {**HELD_OUT, "bokeh_samples": 64}
    config = load_config(ROOT / "configs/synth_planes_val.toml", SynthConfig, overrides)
    return [make_sample(config, index) for index in range(3)]


@pytest.fixture(scope="module", params=["hybrid", "fast", "neural"])
def renders(request, samples):
    """Return the engine and (true defocus, truth, result) of each view."""
    renderer = BokehRenderer(request.param)
    rows = []
    for sample in samples:
        for view in range(2):
            defocus = defocus_from_disparity(
                sample.disparity, float(sample.blur[view]), float(sample.focus[view])
            )
            result = renderer.render_arrays(sample.image.astype(np.float32), defocus)
            rows.append((defocus, sample.bokeh[view].astype(np.float32), result))
    return request.param, rows


def test_networks_improve_pixels_near_edges(renders):
    """Authority: ray-traced truth of held-out scenes; PSNR of pixels whose blur reaches an edge."""
    engine, rows = renders
    neural, classical = (
        mean_scores([compare(getattr(r, name), truth, defocus) for defocus, truth, r in rows])
        for name in ("bokeh", "classical")
    )
    assert neural["edge_psnr"] - classical["edge_psnr"] >= GAIN[engine]
    assert neural["psnr"] > classical["psnr"]


def test_networks_change_no_bit_away_from_edges(renders):
    """Networks change neither colour nor texture beyond the reach of depth discontinuities."""
    for defocus, _, result in renders[1]:
        far = geometric_error_map(defocus) == 0
        np.testing.assert_array_equal(result.bokeh[far], result.classical[far])


def test_the_package_stays_small():
    sizes = {
        name: sum(f.stat().st_size for f in (WEIGHTS / name).iterdir())
        for name in ("hybrid", "neural", "error")
    }
    assert sizes["hybrid"] < 8e6
    assert sizes["neural"] < 6e6
    assert sizes["error"] < 1e6
    assert (WEIGHTS / "MODEL_CARD.md").is_file()


@pytest.mark.parametrize(
    ("kind", "min_gain"), [("clean", 0.0), ("blurred", 1.0), ("eroded", 4.0), ("dilated", 1.0)]
)
def test_the_repair_improves_degraded_maps_and_does_not_change_accurate_ones(shared, kind, min_gain):
    """Authority: a path-traced shot; gain of the rays near edges with "auto", dB."""
    from train.data.degradation import degrade
    from train.scores.evaluation_sets import list_pictures

    folder = shared("cycles/s1_still_life/scene.json").parents[1]
    shot = list_pictures("cycles", folder)[4].read()
    degraded = degrade(shot.defocus, kind)
    repaired = DisparityRepair()(shot.image, degraded, "auto")
    before, after = (
        compare(rays(shot.image, d, aperture=shot.aperture), shot.truth, shot.defocus)["edge_psnr"]
        for d in (degraded, repaired)
    )
    assert after - before >= min_gain
    if kind == "clean":
        np.testing.assert_array_equal(repaired, degraded)


def test_engines_on_an_independent_renderer(shared):
    """Authority: held-out path-traced shots; means over all shots of a scene."""
    from benchmarks.quality.cycles import read_shots, whole_engine
    from benchmarks.quality.tables.score_table import score

    folder = shared("cycles/s1_still_life/scene.json").parent
    names = ("scatter", "fast", "neural", "rays", "hybrid")
    rows = score(read_shots(folder), {name: whole_engine(name) for name in names})
    scores = {name: mean_scores([row[name] for row in rows]) for name in names}
    for name in ("fast", "neural"):
        assert scores[name]["edge_psnr"] > scores["scatter"]["edge_psnr"] + 2.5
    assert scores["rays"]["edge_psnr"] > scores["scatter"]["edge_psnr"] + 4
    assert scores["hybrid"]["edge_psnr"] > scores["rays"]["edge_psnr"] - 0.2
    assert min(row["rays"]["psnr"] - row["scatter"]["psnr"] for row in rows) > -0.2


def test_networks_give_the_same_bits_if_the_process_keeps_freed_memory(monkeypatch):
    rng = np.random.default_rng(5)
    names = ("image", "rays", "scatter", "features")
    arrays = [rng.random((1, channels, 64, 96), np.float32) for channels in (3, 3, 3, len(FEATURES))]
    outputs = []
    for keeps in (False, True):
        monkeypatch.setattr(memory, "_keeps", keeps)
        network = load_network(WEIGHTS / "error", "error", names)
        options = network._session._options
        assert options["enable_cpu_mem_arena"] is not keeps
        # ONNX Runtime raises if there is no memory to release.
        outputs.append(network(*arrays, release=True))
    np.testing.assert_array_equal(*outputs)
