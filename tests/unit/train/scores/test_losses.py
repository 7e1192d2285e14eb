import pytest
import torch

from bokehnet.errors import ConfigError, ParameterError
from bokehnet.optics.encoding import decode
from train.scores.losses import LossWeights, arnet_loss, bokehme_loss, iunet_loss, measured_error
from train.train_arnet import ARNetRun


def pictures() -> list[torch.Tensor]:
    generator = torch.Generator().manual_seed(0)
    return [torch.rand(1, 3, 8, 8, generator=generator) for _ in range(3)]


def test_the_truth_has_no_loss():
    truth, _, classical = pictures()
    target = torch.ones(1, 1, 8, 8)
    loss, _ = arnet_loss(truth, target, classical, truth, target)
    assert loss.item() == 0
    assert iunet_loss(truth, truth, target)[0].item() == 0


def test_an_error_inside_the_target_counts_more_than_one_outside():
    truth, _, _ = pictures()
    target = torch.zeros(1, 1, 8, 8)
    target[..., :4] = 1
    inside, outside = truth.clone(), truth.clone()
    inside[..., 0] += 0.2
    outside[..., 7] += 0.2
    assert iunet_loss(inside, truth, target)[0] > 2 * iunet_loss(outside, truth, target)[0]


def test_the_parts_of_the_loss_add_up_with_their_weights():
    truth, bokeh, classical = pictures()
    error_map, target = 0.5 * torch.ones(1, 1, 8, 8), torch.ones(1, 1, 8, 8)
    requested = {"neural": 3.0, "gradient": 0.0, "fused": 5.0, "error_map": 2.0}
    alone = {
        name: arnet_loss(
            bokeh,
            error_map,
            classical,
            truth,
            target,
            LossWeights(**{**dict.fromkeys(requested, 0), name: 1}),
        )[0]
        for name in requested
    }
    assert min(alone.values()) > 0
    assert alone["error_map"] == 0.25
    loss, parts = arnet_loss(bokeh, error_map, classical, truth, target, LossWeights(**requested))
    for name, weight in requested.items():
        torch.testing.assert_close(parts[name], weight * alone[name])
    torch.testing.assert_close(loss, sum(parts.values()))


@pytest.mark.parametrize("result", [-1.0, float("nan"), float("inf")])
def test_an_invalid_part_of_the_loss_is_reported(result):
    with pytest.raises(ConfigError, match=r"loss\.fused: expected 0 or more, found"):
        LossWeights(fused=result)


def test_negative_predictions_are_pulled_back():
    truth, _, _ = pictures()
    prediction = torch.full_like(truth, -0.5).requires_grad_()
    loss, _ = iunet_loss(prediction, 0 * truth, torch.ones(1, 1, 8, 8))
    loss.backward()
    assert (prediction.grad < 0).all()


def wrong_by(difference, size=8):
    """A grey picture, and one that is wrong by ``difference`` on the perceptual scale in its right half."""
    truth = torch.full((1, 3, size, size), 0.4)
    classical = truth.clone()
    classical[..., size // 2 :] += difference
    return measured_error(decode(classical), decode(truth))[0, 0]


@pytest.mark.parametrize(("difference", "expected"), [(0.009, 0), (0.025, 0.5), (-0.025, 0.5), (0.05, 1)])
def test_errors_from_noise_to_plainly_wrong_become_0_to_1(difference, expected):
    target = wrong_by(difference)
    torch.testing.assert_close(target[:, 5:], torch.full((8, 3), float(expected)), atol=1e-3, rtol=0)
    assert not target[:, :3].any()


def test_an_error_of_one_colour_counts_a_third():
    truth = torch.full((1, 3, 6, 6), 0.4)
    classical = truth.clone()
    classical[:, 1] += 0.075
    assert measured_error(decode(classical), decode(truth)).mean() == pytest.approx(0.5, abs=1e-3)


def test_a_single_noisy_pixel_is_not_an_error():
    truth = torch.full((1, 3, 6, 6), 0.4)
    classical = truth.clone()
    classical[..., 3, 3] += 0.08
    assert measured_error(decode(classical), decode(truth)).max() == 0


def test_unknown_target_is_reported_with_the_known_ones():
    with pytest.raises(ParameterError, match=r"error_target: expected.*geometric.*measured.*got 'guess'"):
        ARNetRun(data=None, optim=None, error_target="guess")


@pytest.mark.parametrize("network_is_better", [True, False])
def test_the_error_map_of_bokehme_follows_the_better_picture(network_is_better):
    """Authority: the fusion's error, which falls as the map rises where the network is better."""
    truth, _, _ = pictures()
    target = torch.full((1, 1, 8, 8), 0.5)
    right, wrong = truth, truth + 0.3
    bokeh, classical = (right, wrong) if network_is_better else (wrong, right)
    error_map = target.clone().requires_grad_()
    loss, parts = bokehme_loss([(bokeh, truth, target)], error_map, classical)
    loss.backward()
    assert set(parts) == {"neural", "gradient", "fused", "error_map"}
    assert ((error_map.grad < 0) == network_is_better).all()
