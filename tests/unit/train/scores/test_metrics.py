import kornia
import numpy as np
import pytest
import torch
from numpy.testing import assert_allclose

from train.scores.metrics import compare, edge_pixels, similarity


def test_psnr_of_a_known_error():
    """An error of 0.1 on the sRGB scale everywhere is 20 dB."""
    from bokehnet.io.color.srgb import srgb_to_linear

    truth, render = (srgb_to_linear(np.full((40, 40, 3), value)) for value in (0.5, 0.6))
    defocus = np.where(np.arange(40) < 20, 4.0, 0.0)[None].repeat(40, 0)
    scores = compare(render, truth, defocus)
    assert scores["psnr"] == pytest.approx(20)
    assert scores["edge_psnr"] == pytest.approx(20)


def test_edge_scores_see_edge_pixels_only():
    rng = np.random.default_rng(0)
    truth = rng.random((60, 60, 3))
    defocus = np.where(np.arange(60) < 30, 5.0, 0.0)[None].repeat(60, 0)
    near = edge_pixels(defocus)
    assert near[:, 24:36].all()
    assert not near[:, :23].any()
    render = np.where(near[..., None], truth, 0.5)
    scores = compare(render, truth, defocus)
    assert scores["edge_psnr"] == 100
    assert scores["psnr"] < 20


def test_a_perfect_render_scores_best_and_no_edges_give_no_edge_score():
    truth = np.random.default_rng(1).random((30, 30, 3))
    scores = compare(truth, truth, np.zeros((30, 30)))
    assert scores["ssim"] == pytest.approx(1)
    assert scores["psnr"] == 100
    assert np.isnan(scores["edge_psnr"])


def test_similarity_is_the_published_one():
    """Oracle: kornia's SSIM, on borders mirrored as here; the mean leaves out half a window around."""
    rng = np.random.default_rng(2)
    expected = rng.random((40, 50, 3))
    expected[:20, :20] = 0
    result = np.clip(expected + 0.1 * rng.standard_normal(expected.shape), 0, 1)
    pair = (np.pad(x, ((5, 5), (5, 5), (0, 0)), mode="symmetric") for x in (expected, result))
    tensors = (torch.from_numpy(x.transpose(2, 0, 1).copy())[None] for x in pair)
    oracle = (
        kornia.metrics.ssim(*tensors, window_size=11, eps=0.0, padding="valid")[0].permute(1, 2, 0).numpy()
    )
    ssim, ssim_map = similarity(expected, result)
    assert_allclose(ssim_map, oracle, atol=1e-12)
    assert ssim == pytest.approx(oracle[5:-5, 5:-5].mean(), abs=1e-12)
