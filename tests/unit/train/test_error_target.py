import pytest
import torch

from bokehnet.errors import ParameterError
from bokehnet.optics.encoding import decode
from train.error_target import measured_error
from train.train_arnet import ARNetRun


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


def test_unknown_target_is_told_with_those_there_are():
    with pytest.raises(ParameterError, match=r"error_target: expected.*geometric.*measured.*got 'guess'"):
        ARNetRun(data=None, optim=None, error_target="guess")
