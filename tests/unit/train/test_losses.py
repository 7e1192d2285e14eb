import torch

from train.losses import arnet_loss, iunet_loss


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


def test_negative_predictions_are_pulled_back():
    truth, _, _ = pictures()
    prediction = torch.full_like(truth, -0.5).requires_grad_()
    loss, _ = iunet_loss(prediction, 0 * truth, torch.ones(1, 1, 8, 8))
    loss.backward()
    assert (prediction.grad < 0).all()
