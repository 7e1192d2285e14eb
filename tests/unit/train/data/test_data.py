"""Training examples: reproducible, true to the pair they come from."""

import json
import shutil

import numpy as np
import pytest
import torch
from numpy.testing import assert_allclose, assert_array_equal

from bokehnet.classical.rays_renderer import render_rays
from bokehnet.errors import ConfigError, DataFileError
from bokehnet.synth.shards import ShardSet
from train.data.crops import DataConfig, PreparedCrops
from train.data.examples import Examples, example_loader
from train.data.prepared import DESCRIPTION, PLANES, PreparedSet, check_features, part_name
from train.prepare import PrepareConfig, prepare


def config_for(folder, **values) -> DataConfig:
    small = {"batch_size": 2, "coarse_crop": 32, "fine_crop": 48}
    return DataConfig(folder=str(folder), validation=str(folder), **{**small, **values})


def examples(config, network_max_radius=None, seed=0) -> Examples:
    return Examples(PreparedCrops(config, network_max_radius), seed=seed, length=100)


def test_a_prepared_example_is_the_pair_and_its_render(tiny_pairs, tiny_prepared):
    """Examples stand in the order of scenes, then views, then the true disparity before augmented ones."""
    sample, planes = ShardSet(tiny_pairs)[1], PreparedSet(tiny_prepared)[6].astype(np.float32)
    image = sample.image.astype(np.float32)
    defocus = sample.blur[1] * (sample.disparity - sample.focus[1])
    render = render_rays(image, defocus)
    assert_array_equal(planes[PLANES["image"]].transpose(1, 2, 0), image)
    assert_array_equal(planes[PLANES["truth"]].transpose(1, 2, 0), sample.bokeh[1].astype(np.float32))
    assert_allclose(planes[PLANES["defocus"]][0], defocus, atol=4e-3)
    assert_allclose(planes[PLANES["classical"]].transpose(1, 2, 0), render.bokeh, rtol=1e-3, atol=1e-3)
    assert_allclose(planes[PLANES["disocclusion_weight"]][0], render.disocclusion_weight, atol=1e-3)
    assert_allclose(planes[PLANES["target"]][0], render.error_map, atol=1e-3)


def test_an_augmented_example_keeps_truth_and_true_edges(tiny_prepared):
    prepared = PreparedSet(tiny_prepared)
    assert len(prepared) == 4 * 2 * 2
    for number in range(0, len(prepared), 2):
        clean, augmented = prepared[number], prepared[number + 1]
        assert_array_equal(clean[PLANES["truth"]], augmented[PLANES["truth"]])
        assert (augmented[PLANES["target"]] >= clean[PLANES["target"]]).all()
    assert any((prepared[i][12] != prepared[i + 1][12]).any() for i in range(0, len(prepared), 2))


def test_a_prepared_set_of_an_earlier_version_is_read(tiny_pairs, tiny_prepared, tmp_path):
    """Its description calls augmented examples spoilt."""
    folder = tmp_path / "old"
    shutil.copytree(tiny_prepared, folder)
    summary = json.loads((folder / DESCRIPTION).read_text())
    summary["config"]["spoilt"] = summary["config"].pop("augmented")
    (folder / DESCRIPTION).write_text(json.dumps(summary))
    assert PreparedSet(folder).per_view == 2
    prepare(PrepareConfig(folder=str(tiny_pairs), scenes_per_part=2), folder)  # nothing is missing


def test_preparing_goes_on_where_it_stopped_and_gives_the_same_bytes(tiny_pairs, tiny_prepared, tmp_path):
    config = PrepareConfig(folder=str(tiny_pairs), scenes_per_part=2)
    prepare(config, tmp_path)
    part = tmp_path / part_name(1)
    expected = part.read_bytes()
    assert expected == (tiny_prepared / part.name).read_bytes()
    part.unlink()
    with pytest.raises(DataFileError, match=r"run python -m train\.prepare again"):
        PreparedSet(tmp_path)
    prepare(config, tmp_path)
    assert part.read_bytes() == expected
    with pytest.raises(ConfigError, match=r"config\.seed = 0, but 1 was requested"):
        prepare(PrepareConfig(folder=str(tiny_pairs), scenes_per_part=2, seed=1), tmp_path)


def test_example_i_depends_on_seed_and_i_alone(tiny_prepared):
    config = config_for(tiny_prepared)
    first, again, other = (examples(config, 10.0, seed=seed)[7] for seed in (3, 3, 4))
    for key, value in first.items():
        torch.testing.assert_close(value, again[key], rtol=0, atol=0)
    assert not torch.equal(first["image"], other["image"])


def test_a_resumed_loader_goes_on_where_the_first_stopped(tiny_prepared):
    config = config_for(tiny_prepared)
    whole, rest = (
        list(example_loader(PreparedCrops(config), config, seed=0, steps=4, first_step=step))
        for step in (0, 2)
    )
    assert len(whole) == 4
    assert len(rest) == 2
    torch.testing.assert_close(whole[2]["image"], rest[0]["image"], rtol=0, atol=0)


def test_coarse_examples_are_halved_towards_one_unit_of_blur(tiny_prepared):
    """Blur reaches 8 pixels; halved once at most, it is at most 4 at the size of a unit of 4."""
    coarse = examples(config_for(tiny_prepared), 4.0)
    for index in range(12):
        example = coarse[index]
        assert example["defocus"].abs().max() <= 4.0
        assert example["image"].shape == example["truth"].shape == (3, 32, 32)
        assert example["features"].shape == (5, 32, 32)


def test_turns_and_gains_are_the_same_for_all_parts(tiny_prepared):
    """Without blur, truth, render and picture agree after any augmentation."""
    for index in range(12):
        example = examples(config_for(tiny_prepared), seed=1)[index]
        sharp = (example["defocus"].abs() < 0.2) & (example["target"] == 0)
        if sharp.sum() > 50:
            difference = (example["image"] - example["truth"]).abs() * sharp
            assert difference.sum() / (3 * sharp.sum()) < 0.25 * example["image"].mean()


@pytest.fixture
def marked(tiny_prepared, tmp_path):
    """A copy of the prepared set in which all light is guessed."""
    folder = tmp_path / "marked"
    shutil.copytree(tiny_prepared, folder)
    for part in folder.glob("*.npy"):
        planes = np.load(part)
        planes[:, PLANES["disocclusion_weight"]] = 1
        np.save(part, planes)
    return folder


def test_several_sets_are_drawn_with_equal_probability(tiny_prepared, marked):
    """Of 60 examples about half are of each: within four standard deviations."""
    mixed = examples(config_for(tiny_prepared, also=(str(marked),)), 10.0)
    of_the_second = sum(bool((mixed[i]["features"][3] == 1).all()) for i in range(60))
    assert 15 <= of_the_second <= 45


def test_sets_of_two_renderers_do_not_mix(tiny_prepared, marked):
    description = marked / DESCRIPTION
    summary = json.loads(description.read_text(encoding="utf-8"))
    summary["config"]["classical"] = "scatter"
    description.write_text(json.dumps(summary), encoding="utf-8")
    with pytest.raises(DataFileError, match="examples of one classical renderer, found rays, scatter"):
        PreparedCrops(config_for(tiny_prepared, also=(str(marked),)), 10.0)


@pytest.mark.parametrize(("classical", "refused"), [("scatter", True), ("rays", False)])
def test_features_need_a_renderer_that_provides_them(classical, refused):
    """Authority: a ray engine has an occluded background; the scatter has none."""
    check_features(False, classical)
    if refused:
        with pytest.raises(ConfigError, match=r"see_features: expected false for examples of scatter"):
            check_features(True, classical)
    else:
        check_features(True, classical)
