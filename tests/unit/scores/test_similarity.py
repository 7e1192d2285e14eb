"""PSNR and SSIM against scikit-image."""

import math

import numpy as np
import pytest

from bokehnet.errors import ShapeError
from bokehnet.scores.similarity import psnr, ssim_map


def pair():
    rng = np.random.default_rng(1)
    reference = rng.random((30, 41, 3))
    return reference, np.clip(reference + 0.1 * rng.normal(size=reference.shape), 0, 1)


def test_psnr_is_scikit_images_and_of_the_pixels_that_count():
    metrics = pytest.importorskip("skimage.metrics")
    reference, test = pair()
    assert psnr(reference, test) == pytest.approx(
        metrics.peak_signal_noise_ratio(reference, test, data_range=1)
    )
    where = np.zeros(reference.shape[:2], bool)
    where[3:9, 4:20] = True
    part = (slice(3, 9), slice(4, 20))
    assert psnr(reference, test, where) == pytest.approx(psnr(reference[part], test[part]))
    assert math.isnan(psnr(reference, test, np.zeros_like(where)))
    assert psnr(test, test) == 100
    with pytest.raises(ShapeError):
        psnr(reference, test[1:])


def test_ssim_is_scikit_images():
    metrics = pytest.importorskip("skimage.metrics")
    reference, test = pair()
    expected, whole = metrics.structural_similarity(
        reference,
        test,
        channel_axis=2,
        data_range=1.0,
        gaussian_weights=True,
        sigma=1.5,
        use_sample_covariance=False,
        full=True,
    )
    result = ssim_map(reference, test)
    assert np.abs(result - whole[5:-5, 5:-5]).max() < 1e-9
    assert result.mean() == pytest.approx(expected)
