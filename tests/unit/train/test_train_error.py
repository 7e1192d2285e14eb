"""ErrorNet: contents of its examples, minimum of its loss at the mean error, and training."""

import json

import numpy as np
import pytest
import torch
from numpy.testing import assert_allclose

from bokehnet.classical.rays_renderer import render_rays
from bokehnet.errors import DataFileError
from bokehnet.models.checkpoint import load_network
from bokehnet.models.error import FEATURES, ErrorNet, ErrorNetConfig
from bokehnet.optics.coc import defocus_from_disparity
from bokehnet.synth.shards import ShardSet
from train.data.error_data import ErrorCrops, ErrorDataConfig, as_tensors, error_parts
from train.data.examples import Examples
from train.data.prepared import DESCRIPTION, NUM_PLANES, PLANES, part_name
from train.prepare import PrepareConfig, prepare
from train.run.schedule import OptimConfig
from train.train_error import ErrorRun, _held_out, error_loss, reliability, run, score, true_error

SMALL = ErrorNetConfig(widths=(8, 8, 8))


@pytest.fixture(scope="module")
def rays_set(tiny_pairs, tmp_path_factory):
    """Four traced scenes, two views each, as the rays render them."""
    folder = tmp_path_factory.mktemp("rays")
    prepare(PrepareConfig(folder=str(tiny_pairs), augmented=0), folder)
    return folder


def config_for(folder, **values) -> ErrorDataConfig:
    return ErrorDataConfig(folder=str(folder), validation=str(folder), batch_size=2, **{"crop": 32, **values})


def test_an_example_holds_the_renders_of_its_pair(rays_set, tiny_pairs):
    """Authority: the renderer itself; scene 1, view 1 stands behind three others."""
    sample = ShardSet(tiny_pairs)[1]
    image = sample.image.astype(np.float32)
    defocus = defocus_from_disparity(sample.disparity, float(sample.blur[1]), float(sample.focus[1]))
    planes = ErrorCrops(config_for(rays_set)).sets[0][3]
    height, width = defocus.shape
    result = error_parts(planes, slice(0, height), slice(0, width))
    expected = render_rays(image, defocus)
    pictures = {"image": image, "rays": expected.bokeh, "truth": sample.bokeh[1]}
    for name, picture in pictures.items():
        assert_allclose(result[name].transpose(1, 2, 0), picture, rtol=1e-3, atol=1e-3)
    maps = np.stack([defocus, expected.disocclusion_weight, expected.error_map])
    assert_allclose(result["features"], maps, rtol=1e-3, atol=4e-3)
    assert_allclose(result["scatter"].transpose(1, 2, 0), expected.scatter, rtol=2e-3, atol=2e-3)


def test_a_window_equals_that_part_of_the_whole(rays_set):
    """Oracle: the parts of the whole example; the scatter of a window knows what spreads into it."""
    planes = ErrorCrops(config_for(rays_set)).sets[0][2]
    rows, columns = slice(8, 40), slice(16, 48)
    part = error_parts(planes, rows, columns)
    whole = error_parts(planes, *(slice(0, side) for side in planes.shape[1:]))
    for name, array in part.items():
        assert_allclose(array, whole[name][:, rows, columns], rtol=1e-4, atol=1e-5)


def test_true_error_is_levels_of_the_srgb_picture():
    """By hand: sRGB 0.5 in place of 0.25 is 63.75 levels, in one of three colours; above white is white."""
    level = {0.25: 0.05087608, 0.5: 0.21404114}  # IEC 61966-2-1
    truth = torch.full((1, 3, 8, 8), level[0.25])
    rays = truth.clone()
    rays[:, 1] = level[0.5]
    rays[:, :, 4:] = 3.0
    error = true_error({"truth": truth, "rays": rays})
    assert error.shape == (1, 1, 8, 8)
    assert_allclose(error[0, 0, 0], 63.75 / 3, atol=1e-3)
    assert_allclose(error[0, 0, 7], 191.25, atol=1e-3)


def test_the_loss_is_least_where_the_mean_error_is_expected():
    errors = torch.distributions.Exponential(0.25).sample((1, 1, 64, 64)) + 1
    whole = torch.ones(1, 1, 64, 64)
    tried = torch.linspace(1, 12, 111)
    losses = [float(error_loss(x * whole, errors, whole)) for x in tried]
    assert float(tried[int(np.argmin(losses))]) == pytest.approx(float(errors.mean()), abs=0.06)


def test_reliability_lists_expected_and_measured_errors():
    expected = np.linspace(1, 20, 200)
    pairs = reliability(expected[::-1], 2 * expected[::-1])
    assert len(pairs) == 10
    assert_allclose([true / message for message, true in pairs], 2)
    assert pairs == sorted(pairs)


@pytest.mark.parametrize("halved", [0.0, 1.0])
def test_examples_follow_from_seed_and_number(rays_set, halved):
    config = config_for(rays_set, halved=halved, crop=16)
    first, again = (Examples(ErrorCrops(config), seed=3, length=9)[5] for _ in range(2))
    assert set(first) == {"image", "rays", "scatter", "truth", "features"}
    for name, x in first.items():
        assert torch.equal(x, again[name])
        assert x.shape[1:] == (16, 16)


def test_exposure_scales_light_alone(rays_set):
    planes = ErrorCrops(config_for(rays_set)).sets[0][0]
    parts = error_parts(planes, slice(0, 16), slice(0, 16))
    plain, bright = as_tensors(parts), as_tensors(parts, 2.0)
    for name in ("image", "rays", "scatter", "truth"):
        assert torch.equal(bright[name], 2 * plain[name])
    assert torch.equal(bright["features"], plain["features"])


def test_a_set_of_the_scatter_is_refused(tiny_pairs, tmp_path):
    prepare(PrepareConfig(folder=str(tiny_pairs), classical="scatter", augmented=0), tmp_path)
    with pytest.raises(DataFileError, match="expected examples of the rays, found those of scatter"):
        ErrorCrops(config_for(tmp_path))


@pytest.mark.parametrize("light", [0.0, 1.0, 1e5])
def test_what_is_expected_is_finite_and_positive_whatever_the_light(light):
    torch.manual_seed(0)
    network = ErrorNet(SMALL).eval()
    torch.nn.init.normal_(network.unet.head.weight)
    pictures = [light * torch.rand(1, 3, 16, 24) for _ in range(3)]
    with torch.no_grad():
        result = network(*pictures, torch.zeros(1, len(FEATURES), 16, 24))
    assert result.shape == (1, 1, 16, 24)
    assert torch.isfinite(result).all()
    assert (result >= 0.0499).all()


@pytest.fixture
def uneven_set(tmp_path):
    """Pictures whose rays are off by an amount that follows from the share of guessed light."""
    rng = np.random.default_rng(0)
    planes = np.zeros((8, NUM_PLANES, 64, 64), np.float32)
    for example in planes:
        truth = 0.2 + 0.6 * rng.random((3, 1, 1)) * np.ones((1, 64, 64))
        guessed = np.kron(rng.random((4, 4)), np.ones((16, 16)))
        for name in ("image", "classical", "truth"):
            example[PLANES[name]] = truth
        example[PLANES["classical"]] += 0.05 * guessed**2 * rng.choice([-1, 1], (3, 64, 64))
        example[PLANES["disocclusion_weight"]] = guessed
        example[PLANES["classical_error_map"]] = example[PLANES["target"]] = 1.0
    np.save(tmp_path / part_name(0), planes.astype(np.float16))
    (tmp_path / DESCRIPTION).write_text(json.dumps({"parts": 1, "config": {"augmented": 0}}))
    return tmp_path


@pytest.mark.train
def test_it_learns_what_errors_follow_from_and_exports(uneven_set, tmp_path):
    """Errors of a known size: predicted in their order, and of that size within a third in every bin."""
    from bokehnet.models.onnx_export import export_networks

    optim = OptimConfig(steps=250, learning_rate=5e-3, warmup=5, average=0.95, bfloat16=False)
    config = ErrorRun(
        data=config_for(uneven_set, max_exposure=0.2, halved=0.0), optim=optim, model=SMALL, held_out=4
    )
    network = load_network(run(config, tmp_path / "run", torch.device("cpu"), 10.0), "error")
    scores = score(network, _held_out(config), torch.device("cpu"))
    assert scores["spearman"] > 0.9
    assert scores["calibration"] < 1.5
    assert export_networks({"error": network}, tmp_path / "weights", {})["error"] < 1e-4
