"""ErrorNet: its examples are what they say, its loss asks for the mean error, and it trains."""

import json

import numpy as np
import pytest
import torch
from numpy.testing import assert_allclose, assert_array_equal

from bokehnet.classical.rays_renderer import rays, render_rays
from bokehnet.inference.engine import Engine
from bokehnet.models.checkpoint import load_network
from bokehnet.models.error import ErrorNet, ErrorNetConfig
from bokehnet.synth.shards import ShardSet
from train.error_data import (
    ERROR_PLANES,
    ErrorCrops,
    ErrorDataConfig,
    ErrorSetConfig,
    prepare_errors,
    rays_noise,
    split_planes,
)
from train.examples import Examples
from train.prepared import DESCRIPTION, part_name
from train.schedule import OptimConfig
from train.train_error import ErrorRun, _held_out, error_loss, reliability, run, score, true_errors

SMALL = ErrorNetConfig(widths=(8, 8, 8))


@pytest.fixture(scope="module")
def error_set(tiny_pairs, random_weights, tmp_path_factory):
    """Four traced scenes, two views each, with true disparity and augmented one."""
    folder = tmp_path_factory.mktemp("error")
    config = ErrorSetConfig(folder=str(tiny_pairs), neural=str(random_weights), repair="", scenes_per_part=2)
    prepare_errors(config, folder)
    return folder


def config_for(folder, **values) -> ErrorDataConfig:
    return ErrorDataConfig(folder=str(folder), validation=str(folder), batch_size=2, crop=32, **values)


def test_an_example_holds_the_renders_of_its_pair(error_set, tiny_pairs, random_weights):
    """Authority: the renderers themselves; scene 1, view 1, true disparity stands behind six others."""
    sample = ShardSet(tiny_pairs)[1]
    image = sample.image.astype(np.float32)
    defocus = sample.blur[1] * (sample.disparity - sample.focus[1])
    planes = ErrorCrops(config_for(error_set)).sets[0][6].astype(np.float32)
    other = Engine("fast", weights=random_weights, threads=1).render(image, defocus)
    found = render_rays(image, defocus)
    for name, wanted in (
        ("image", image),
        ("rays", found.bokeh),
        ("scatter", other.classical),
        ("neural", other.neural),
        ("truth", sample.bokeh[1]),
    ):
        assert_allclose(planes[ERROR_PLANES[name]].transpose(1, 2, 0), wanted, rtol=1e-3, atol=1e-3)
    noise = rays_noise(found.bokeh, rays(image, defocus, seed=1))
    wanted = np.stack([defocus, noise, found.disocclusion_weight, found.error_map])
    assert_allclose(planes[ERROR_PLANES["features"]], wanted, rtol=1e-3, atol=4e-3)


def test_noise_is_told_by_its_standard_deviation():
    """Authority: noise of deviation 0.03 that was drawn; its estimate over 25 pixels and 3 colours."""
    rng = np.random.default_rng(0)
    first, second = 0.5 + 0.03 * rng.standard_normal((2, 64, 64, 3))
    assert rays_noise(first, second).mean() == pytest.approx(0.03, rel=0.02)
    assert_array_equal(rays_noise(first, first), 0)


def test_true_errors_are_levels_of_the_srgb_picture():
    """By hand: sRGB 0.5 in place of 0.25 is 63.75 levels, in one of three colours; above white is white."""
    level = {0.25: 0.05087608, 0.5: 0.21404114}  # IEC 61966-2-1
    truth = torch.full((1, 3, 8, 8), level[0.25])
    rays_ = truth.clone()
    rays_[:, 1] = level[0.5]
    batch = {"truth": truth, "rays": rays_, "scatter": truth, "neural": torch.full_like(truth, 3.0)}
    errors = true_errors(batch)
    assert errors.shape == (1, 3, 8, 8)
    assert_allclose(errors[0, :, 0, 0], [63.75 / 3, 0, 191.25], atol=1e-3)


def test_the_loss_is_least_where_the_mean_error_is_expected():
    errors = torch.distributions.Exponential(0.25).sample((1, 1, 64, 64)) + 1
    whole = torch.ones(1, 1, 64, 64)
    tried = torch.linspace(1, 12, 111)
    losses = [float(error_loss(x * whole, errors, whole)) for x in tried]
    assert float(tried[int(np.argmin(losses))]) == pytest.approx(float(errors.mean()), abs=0.06)


def test_reliability_tells_what_was_expected_and_what_came():
    expected = np.linspace(1, 20, 200)
    pairs = reliability(expected[::-1], 2 * expected[::-1])
    assert len(pairs) == 10
    assert_allclose([true / told for told, true in pairs], 2)
    assert pairs == sorted(pairs)


def test_examples_follow_from_seed_and_number_and_light_scales_noise(error_set):
    first, again = (Examples(ErrorCrops(config_for(error_set)), seed=3, length=9)[5] for _ in range(2))
    assert set(first) == set(ERROR_PLANES)
    for name, x in first.items():
        assert torch.equal(x, again[name])
        assert x.shape[1:] == (32, 32)
    planes = np.random.default_rng(0).random((19, 8, 8), dtype=np.float32)
    plain, bright = split_planes(planes), split_planes(planes, 2.0)
    assert torch.equal(bright["rays"], 2 * plain["rays"])
    ratio = bright["features"] / plain["features"]
    assert_allclose(ratio.mean((1, 2)), [1, 2, 1, 1], rtol=1e-6)


@pytest.mark.parametrize("light", [0.0, 1.0, 1e5])
def test_what_is_expected_is_finite_and_positive_whatever_the_light(light):
    torch.manual_seed(0)
    network = ErrorNet(SMALL).eval()
    torch.nn.init.normal_(network.unet.head.weight)
    pictures = [light * torch.rand(1, 3, 16, 24) for _ in range(4)]
    with torch.no_grad():
        found = network(*pictures, torch.zeros(1, 4, 16, 24))
    assert found.shape == (1, 3, 16, 24)
    assert torch.isfinite(found).all()
    assert (found >= 0.0499).all()


@pytest.fixture
def noisy_set(tmp_path):
    """Pictures whose rays have noise of a known strength, and whose scatter is off on the left half."""
    rng = np.random.default_rng(0)
    planes = np.zeros((8, 19, 64, 64), np.float32)
    for example in planes:
        truth = 0.2 + 0.6 * rng.random((3, 1, 1)) * np.ones((1, 64, 64))
        strength = 0.05 * np.kron(rng.random((4, 4)), np.ones((16, 16))) ** 2
        for name in ("image", "rays", "scatter", "neural", "truth"):
            example[ERROR_PLANES[name]] = truth
        example[ERROR_PLANES["rays"]] += strength * rng.standard_normal((3, 64, 64))
        example[ERROR_PLANES["scatter"], :, :32] += 0.04
        example[15:] = np.stack([3 * np.ones((64, 64)), strength, np.zeros((64, 64)), np.ones((64, 64))])
    np.save(tmp_path / part_name(0), planes.astype(np.float16))
    (tmp_path / DESCRIPTION).write_text(json.dumps({"parts": 1, "config": {"augmented": 0}}))
    return tmp_path


@pytest.mark.train
def test_it_learns_what_errors_follow_from_and_exports(noisy_set, tmp_path):
    """Noise of known strength and a known offset: their order, and which candidate has none of both."""
    from bokehnet.models.onnx_export import export_networks

    optim = OptimConfig(steps=250, learning_rate=5e-3, warmup=5, average=0.95, bfloat16=False)
    config = ErrorRun(data=config_for(noisy_set, max_exposure=0.2), optim=optim, model=SMALL, held_out=4)
    network = load_network(run(config, tmp_path / "run", torch.device("cpu"), 10.0), "error")
    scores = score(network, _held_out(config), torch.device("cpu"))
    assert scores["spearman/rays"] > 0.4
    assert scores["spearman/scatter"] > 0.5
    assert scores["chosen"] < 0.1 * min(scores["error/rays"], scores["error/scatter"])
    assert export_networks({"error": network}, tmp_path / "weights", {})["error"] < 1e-4
