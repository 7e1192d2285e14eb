"""Training of LightNet: the closed form as its start, the loss of discs, and a small run."""

import json

import numpy as np
import pytest
import torch

from bokehnet.models.light import CLOSED_FORM, FEATURES, LightNet, LightNetConfig
from train.data.light_data import LightExamples, LightScenesConfig, make_scene
from train.data.light_regions import learned_sums, measured_regions
from train.data.light_scenes import CameraCurve, decoded, light_picture
from train.train_light import disc_error, light_loss, main

pytestmark = pytest.mark.train


def regions(count=6, seed=0):
    rng = np.random.default_rng(seed)
    stored = rng.uniform(1, 50, (count, 3)).astype(np.float32)
    return {
        "features": torch.from_numpy(rng.standard_normal((count, FEATURES)).astype(np.float32)),
        "stored": torch.from_numpy(stored),
        "true": torch.from_numpy(stored * rng.uniform(1, 9, (count, 1)).astype(np.float32)),
        "surround": torch.zeros(count, 3),
        "area": torch.from_numpy(rng.uniform(4, 90, count).astype(np.float32)),
    }


def test_an_untrained_network_returns_the_closed_form():
    features = regions()["features"]
    features[:, CLOSED_FORM] = features[:, CLOSED_FORM].abs()
    log_gain, probability = LightNet(LightNetConfig()).eval()(features)
    assert float(probability.detach().min()) > 0.98
    torch.testing.assert_close(log_gain, probability * features[:, CLOSED_FORM])


def test_discs_of_the_true_light_have_no_error():
    batch = regions()
    true = batch["true"] / batch["stored"]
    assert float(disc_error(true, batch).abs().max()) < 1e-9
    assert float(disc_error(torch.ones(6, 3), batch).min()) > 0


def test_a_step_along_the_gradient_lowers_the_loss():
    network = LightNet(LightNetConfig()).eval()
    batch = {name: x[None] for name, x in regions().items()}
    optimizer = torch.optim.SGD(network.parameters(), 0.05)
    losses = []
    for _ in range(3):
        loss, _ = light_loss(network, batch)
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
        losses.append(float(loss.detach()))
    assert losses[2] < losses[0]


def test_the_network_of_the_closed_form_changes_nothing():
    """Oracle: the sums of the closed form."""
    image, disparity = light_picture("lamps", np.random.default_rng([3, 1]), 1, 1)
    stored = decoded(CameraCurve().store(image))
    measured = measured_regions(stored, disparity)
    sums = learned_sums(stored, disparity, lambda features: features[:, CLOSED_FORM])
    assert measured is not None
    np.testing.assert_allclose(sums, measured.closed, rtol=1e-4)


def test_data_and_training_resume(tmp_path):
    config = LightScenesConfig(kinds=("lamps", "cards"), scenes=2, cameras=2)
    (tmp_path / "data").mkdir()
    for number in range(2):
        make_scene(number, config, tmp_path / "data" / f"scene-{number:05d}.npz")
    assert len(LightExamples(str(tmp_path / "data")).is_light) > 4
    text = f"""
[data]
folder = "{tmp_path / "data"}"
validation = "{tmp_path / "data"}"
[optim]
steps = 4
validate_every = 2
checkpoint_every = 2
bfloat16 = false
"""
    (tmp_path / "config.toml").write_text(text)
    words = ["--config", str(tmp_path / "config.toml"), "--out", str(tmp_path / "run"), "--device", "cpu"]
    main(words)
    first = (tmp_path / "run" / "last.pt").read_bytes()
    main(words)
    assert (tmp_path / "run" / "last.pt").read_bytes() == first
    assert json.loads((tmp_path / "run" / "config.json").read_text())
