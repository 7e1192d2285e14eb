"""Examples for EdgeNet."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from bokehnet.config import load_config
from bokehnet.errors import DataFileError
from bokehnet.synth import SynthConfig, write_dataset
from tests.unit.train.runs import ROOT
from train.edge_data import EdgeDataConfig, edge_pair, edge_source
from train.examples import Examples
from train.train_edges import EdgeRun, run

CONFIG = EdgeDataConfig(folder="", validation="", clean=1.0, bent=0.0, crop=32, around=8, samples=16)


def scene(seed: int = 0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A near disc; disparity at the centres of pixels and four times finer."""
    y, x = (np.mgrid[:256, :256] + 0.5) / 4
    fine = np.where((x - 30) ** 2 + (y - 34) ** 2 < 18**2, 0.8, 0.1).astype(np.float32)
    v, u = np.mgrid[:64, :64] + 0.5
    coarse = np.where((u - 30) ** 2 + (v - 34) ** 2 < 18**2, 0.8, 0.1).astype(np.float32)
    image = np.random.default_rng(seed).random((64, 64, 3)).astype(np.float32)
    return image, coarse, fine


@pytest.mark.parametrize("seed", range(6))
def test_what_is_inside_pixels_lies_where_the_map_does(seed):
    """The share of the disc inside its pixels, turned and mirrored with it, against counting them."""
    pair = edge_pair(*scene(), np.random.default_rng(seed), CONFIG)
    assert pair["image"].shape == (3, 32, 32)
    assert_array_equal(pair["disparity"], pair["truth"])
    share = (pair["inside"] > 0.5).mean(0)
    near = pair["truth"][0] > 0.5
    assert (share[near] > 0.3).all()
    assert (share[~near] < 0.7).all()
    assert ((share > 0.05) & (share < 0.95)).sum() >= near.any() * 4


def test_disparity_inside_pixels_is_bent_with_the_map():
    bent = EdgeDataConfig(folder="", validation="", clean=1.0, bent=1.0, crop=32, around=8)
    pair = edge_pair(*scene(), np.random.default_rng(1), bent)
    assert set(np.unique(pair["inside"])) <= set(np.unique(pair["truth"])) | {0.0, 1.0}


@pytest.fixture(scope="module")
def fine_set(tmp_path_factory):
    folder = tmp_path_factory.mktemp("fine")
    config = replace(
        load_config(ROOT / "configs/synth_edges_planes.toml", SynthConfig),
        scenes=2,
        scenes_per_shard=2,
        width=48,
        height=48,
    )
    write_dataset(config, folder)
    return folder


def test_examples_follow_from_seed_and_number_and_train(fine_set, tmp_path):
    import torch

    from train.schedule import OptimConfig

    data = EdgeDataConfig(folder=str(fine_set), validation=str(fine_set), batch_size=2, crop=32, around=8)
    first, second = (Examples(edge_source(data), seed=3, length=4)[2] for _ in range(2))
    for name, values in first.items():
        assert_array_equal(values, second[name])
    optim = OptimConfig(steps=2, validate_every=2, warmup=1)
    checkpoint = run(EdgeRun(data=data, optim=optim, held_out=1), tmp_path / "run", torch.device("cpu"), 5.0)
    assert checkpoint.exists()


def test_sets_without_fine_disparity_are_named(tiny_pairs):
    data = EdgeDataConfig(folder=str(tiny_pairs), validation="")
    with pytest.raises(DataFileError, match="fine disparity"):
        edge_source(data)
