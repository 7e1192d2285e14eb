"""The networks that ship with the package do what they are for."""

import numpy as np
import pytest

from bokehnet.classical.error_map import geometric_error_map
from bokehnet.config import load_config
from bokehnet.inference.pipeline import BokehRenderer
from bokehnet.inference.session import WEIGHTS
from bokehnet.optics.coc import defocus_from_disparity
from bokehnet.synth import SynthConfig
from bokehnet.synth.pairs import make_sample
from tests.conftest import ROOT
from train.metrics import compare, mean_scores

HELD_OUT = {"seed": 77, "width": 160, "height": 160, "views": 2, "defocus": [4.0, 14.0]}


@pytest.fixture(scope="module")
def renders():
    """Three scenes that nobody trained on: (true defocus, truth, hybrid result) of each view."""
    config = load_config(
        ROOT / "configs/synth_planes_val.toml", SynthConfig, {**HELD_OUT, "bokeh_samples": 64}
    )
    renderer = BokehRenderer("hybrid")
    rows = []
    for index in range(3):
        sample = make_sample(config, index)
        for view in range(2):
            defocus = defocus_from_disparity(
                sample.disparity, float(sample.blur[view]), float(sample.focus[view])
            )
            result = renderer.render(sample.image.astype(np.float32), defocus)
            rows.append((defocus, sample.bokeh[view].astype(np.float32), result))
    return rows


def test_hybrid_beats_scatter_near_edges_by_a_decibel(renders):
    """Authority: ray-traced truth of held-out scenes, PSNR over pixels within the blur's reach of an edge."""
    hybrid, scatter = (
        mean_scores([compare(getattr(r, name), truth, defocus) for defocus, truth, r in renders])
        for name in ("bokeh", "classical")
    )
    assert hybrid["edge_psnr"] - scatter["edge_psnr"] >= 1.0
    assert hybrid["psnr"] > scatter["psnr"]


def test_away_from_edges_the_hybrid_is_the_scatter_bit_for_bit(renders):
    """Neither a colour shift nor a texture lost beyond the reach of any depth discontinuity."""
    for defocus, _, result in renders:
        far = geometric_error_map(defocus) == 0
        np.testing.assert_array_equal(result.bokeh[far], result.classical[far])


def test_the_package_stays_small():
    assert sum(file.stat().st_size for file in WEIGHTS.iterdir()) < 12e6
    assert (WEIGHTS / "MODEL_CARD.md").is_file()


def test_engines_on_an_independent_renderer(shared):
    """Authority: path-traced shots that nothing was trained on; means over all shots of a scene."""
    from benchmarks.cycles import read_shots, whole_engine
    from benchmarks.quality import score

    folder = shared("cycles/s1_still_life/scene.json").parent
    rows = score(read_shots(folder), {name: whole_engine(name) for name in ("scatter", "rays", "hybrid")})
    scores = {name: mean_scores([row[name] for row in rows]) for name in rows[0]}
    assert scores["hybrid"]["edge_psnr"] > scores["scatter"]["edge_psnr"]
    assert scores["hybrid"]["psnr"] > scores["scatter"]["psnr"]
    assert scores["rays"]["edge_psnr"] > scores["scatter"]["edge_psnr"] + 4
    assert min(row["rays"]["psnr"] - row["scatter"]["psnr"] for row in rows) > -0.2
