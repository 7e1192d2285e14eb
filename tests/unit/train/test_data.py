"""Training examples: reproducible, true to the pair they come from."""

from pathlib import Path

import numpy as np
import pytest
import torch
from numpy.testing import assert_allclose

from bokehnet.classical.scatter import scatter
from bokehnet.synth.shards import ShardSet
from train.data import DataConfig, Examples, example_loader, make_example, spoil_disparity


def config_for(folder: Path, **values) -> DataConfig:
    return DataConfig(
        folder=str(folder), validation=str(folder), **{"batch_size": 2, "coarse_crop": 32, **values}
    )


def test_without_variation_an_example_is_the_pair_and_its_scatter(tiny_pairs):
    sample = ShardSet(tiny_pairs)[0]
    example = make_example(sample, 1, None, config_for(tiny_pairs))
    image = sample.image.astype(np.float32)
    defocus = sample.blur[1] * (sample.disparity - sample.focus[1])
    assert_allclose(example["image"].permute(1, 2, 0).numpy(), image)
    assert_allclose(example["truth"].permute(1, 2, 0).numpy(), sample.bokeh[1].astype(np.float32))
    assert_allclose(example["defocus"][0].numpy(), defocus, rtol=1e-5, atol=1e-6)
    assert_allclose(example["classical"].permute(1, 2, 0).numpy(), scatter(image, defocus), rtol=1e-4)


def test_example_i_depends_on_seed_and_i_alone(tiny_pairs):
    config = config_for(tiny_pairs)
    first, again, other = (Examples(config, seed, 10, 10.0)[7] for seed in (3, 3, 4))
    for key, value in first.items():
        torch.testing.assert_close(value, again[key], rtol=0, atol=0)
    assert not torch.equal(first["image"], other["image"])


def test_a_resumed_loader_goes_on_where_the_first_stopped(tiny_pairs):
    config = config_for(tiny_pairs)
    whole = list(example_loader(config, seed=0, steps=4, first_step=0))
    rest = list(example_loader(config, seed=0, steps=4, first_step=2))
    assert len(whole) == 4
    assert len(rest) == 2
    torch.testing.assert_close(whole[2]["image"], rest[0]["image"], rtol=0, atol=0)


def test_coarse_examples_have_at_most_one_unit_of_blur(tiny_pairs):
    examples = Examples(config_for(tiny_pairs), 0, 12, 4.0)
    for index in range(12):
        assert examples[index]["defocus"].abs().max() <= 4.0
        assert examples[index]["truth"].shape[0] == 3


@pytest.mark.parametrize("seed", range(6))
def test_spoilt_disparity_stays_in_the_range_of_the_true_one(seed):
    rng = np.random.default_rng(seed)
    disparity = np.kron(rng.random((4, 4)), np.ones((16, 16))).astype(np.float32)
    spoilt = spoil_disparity(disparity, rng)
    assert spoilt.shape == disparity.shape
    assert spoilt.min() >= disparity.min() - 1e-6
    assert spoilt.max() <= disparity.max() + 1e-6
    assert np.abs(spoilt - disparity).max() > 0.01
