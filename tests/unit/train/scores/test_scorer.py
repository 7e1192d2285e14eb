import importlib.util
import json
import math

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from bokehnet.io.color.srgb import srgb_to_linear
from train.scores.metrics import BANDS, Scorer, band_label, compare, depth_step_pixels

# A near left and a far right half; radii of 15 and 5 px.
DEFOCUS = np.where(np.arange(200) < 100, 15.0, -5.0)[None].repeat(180, 0)
DISPARITY = np.where(np.arange(200) < 100, 1.0, 0.2)[None].repeat(180, 0)


@pytest.fixture(scope="module")
def truth():
    noise = np.random.default_rng(0).random((180, 200, 3))
    return gaussian_filter(noise, (1, 1, 0)).astype(np.float32)


@pytest.fixture(scope="module")
def scorer(truth):
    return Scorer(truth, DEFOCUS, DISPARITY)


def test_the_truth_has_the_best_scores(truth, scorer):
    scores = scorer(truth)
    assert {scores[key] for key in ("psnr", "edge_psnr", "step_psnr", "flat_psnr", "log_psnr")} == {100}
    assert scores["ms_ssim"] == pytest.approx(1)
    assert scores["flip"] == scores["edge_flip"] == 0


def test_scores_equal_those_of_compare(truth, scorer):
    render = truth + 0.1 * np.random.default_rng(1).random(truth.shape)
    scores = scorer(render)
    for key, value in compare(render, truth, DEFOCUS).items():
        assert scores[key] == pytest.approx(value, rel=1e-12)


def _halves(picture):
    return picture.reshape(picture.shape[0] // 2, 2, picture.shape[1] // 2, 2).mean((1, 3))


def _ms_ssim(a, b):
    """One channel, from the formulas of Wang, Simoncelli and Bovik 2003; sides are multiples of 16."""
    total = 1.0
    exponents = (0.0448, 0.2856, 0.3001, 0.2363, 0.1333)
    for scale, exponent in enumerate(exponents):
        inside = (slice(5, -5), slice(5, -5))

        def mean(x, inside=inside):
            return gaussian_filter(x, 1.5, radius=5)[inside]

        ma, mb = mean(a), mean(b)
        va, vb, vab = mean(a * a) - ma**2, mean(b * b) - mb**2, mean(a * b) - ma * mb
        contrast = (2 * vab + 0.03**2) / (va + vb + 0.03**2)
        luminance = (2 * ma * mb + 0.01**2) / (ma**2 + mb**2 + 0.01**2)
        total *= (contrast * (luminance if scale == 4 else 1)).mean() ** exponent
        if scale < 4:
            a, b = _halves(a), _halves(b)
    return total


def test_ms_ssim_is_what_its_authors_define():
    rng = np.random.default_rng(2)
    target = gaussian_filter(rng.random((192, 208, 3)), (2, 2, 0))
    result = np.clip(gaussian_filter(target, (1, 1, 0)) + 0.02 * rng.standard_normal(target.shape), 0, 1)
    defocus = np.zeros(target.shape[:2])
    scores = Scorer(srgb_to_linear(target), defocus)(srgb_to_linear(result))
    expected = np.mean([_ms_ssim(target[..., c], result[..., c]) for c in range(3)])
    assert scores["ms_ssim"] == pytest.approx(expected, abs=1e-4)
    assert expected < 0.98


def test_pictures_too_small_for_ms_ssim_have_no_ms_ssim():
    truth = np.random.default_rng(3).random((160, 200, 3))
    assert math.isnan(Scorer(truth, np.zeros((160, 200)))(truth)["ms_ssim"])


def test_flip_sees_where_the_pictures_differ(truth, scorer):
    """White for black is as visible as anything can be; far from edges it is no matter of edge pixels."""
    black = Scorer(np.zeros_like(truth), DEFOCUS, DISPARITY)
    assert black(np.ones_like(truth))["flip"] > 0.95
    render = np.where(np.arange(200)[None, :, None] < 40, 1 - truth, truth)
    scores = scorer(render)
    assert scores["flip"] > 0.02
    assert scores["edge_flip"] < 1e-3


def test_log_psnr_sees_light_above_white():
    """Authority: PSNR of log(1 + x), peak log(1 + max); both pictures clip to the same white."""
    truth = np.full((20, 20, 3), 7.0)
    scores = Scorer(truth, np.zeros((20, 20)))(np.full((20, 20, 3), 3.0))
    assert scores["psnr"] == 100
    assert scores["log_psnr"] == pytest.approx(20 * math.log10(math.log(8) / (math.log(8) - math.log(4))))


def test_bands_separate_true_radii(truth, scorer):
    render = np.where(DEFOCUS[..., None] == 15, srgb_to_linear(np.full_like(truth, 0.6)), truth)
    scores = scorer(render)
    assert scores["psnr_0-10"] == 100
    assert scores["psnr_10-20"] < 30
    assert math.isnan(scores["psnr_20-40"])
    assert math.isnan(scores["edge_psnr_>40"])
    assert scores["edge_psnr_0-10"] == 100
    assert [band_label(band) for band in BANDS] == ["0-10", "10-20", "20-40", ">40"]


def test_flat_pixels_are_all_but_edge_pixels(truth, scorer):
    near = np.abs(np.arange(200) - 99.5) < 40
    classical = np.where(near[None, :, None], truth, truth + 0.01)
    render = np.where(near[None, :, None], 0, truth).astype(np.float32)
    scores = scorer(render, classical)
    assert scores["flat_psnr"] < 20  # edges reach 15 px, less than the 40 that are black
    far = np.where(np.abs(np.arange(200) - 99.5)[None, :, None] < 15, 0, truth)
    assert scorer(far)["flat_psnr"] == 100
    of_classical = scorer(classical)["flat_psnr"]
    scores = scorer(truth, classical)
    assert scores["flat_psnr_like"] == pytest.approx(of_classical)
    assert scores["flat_psnr_gain"] == pytest.approx(100 - of_classical)
    assert math.isnan(scorer(truth)["flat_psnr_like"])


def test_depth_steps_are_those_of_a_plain_loop():
    """Authority: the definition, pixel by pixel: depths of neighbours more than 5 % of the larger apart."""
    rng = np.random.default_rng(4)
    depth = 1 + 0.03 * rng.random((24, 30))
    depth[8:14, 10:20] *= 0.5
    depth[:4] = np.inf
    disparity = 1 / depth
    defocus = 3 * (disparity - 1.2)
    expected = np.zeros(depth.shape, bool)
    rows, columns = np.indices(depth.shape)
    for y in range(24):
        for x in range(30):
            for v, u in ((y, x + 1), (y + 1, x)):
                if v == 24 or u == 30:
                    continue
                near, far = sorted((depth[y, x], depth[v, u]))
                if (np.isinf(far) and np.isfinite(near)) or (np.isfinite(far) and far - near > 0.05 * far):
                    reach = math.ceil(max(abs(defocus[y, x]), abs(defocus[v, u]), 1))
                    for b, a in ((y, x), (v, u)):
                        expected |= (rows - b) ** 2 + (columns - a) ** 2 <= reach**2
    assert 0.1 < expected.mean() < 0.9
    np.testing.assert_array_equal(depth_step_pixels(disparity, defocus), expected)


def test_scores_agree_with_those_of_the_path_traced_set(shared):
    """Authority: the script that came with the path-traced scenes, on a scatter of one shot."""
    from bokehnet.classical.scatter_renderer import scatter
    from train.scores.evaluation_sets import list_pictures

    script = shared("cycles/score.py")
    spec = importlib.util.spec_from_file_location("path_traced_score", script)
    reference = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(reference)
    folder = script.parent / "s4_corridor"
    scene = json.loads((folder / "scene.json").read_text())
    depth = reference.read(str(folder / "depth.exr")).astype(np.float64)
    picture = next(p for p in list_pictures("cycles", script.parent) if p.scene == "s4_corridor")
    shot = picture.read()
    render = scatter(shot.image, shot.defocus)
    mask = reference.edge_mask(depth, scene, scene["shots"][0])
    expected = reference.score(render, shot.truth, mask)
    scores = Scorer(shot.truth, shot.defocus, shot.disparity)(render)
    for result, name in (("psnr", "psnr"), ("ssim", "ssim"), ("log_psnr", "log"), ("step_psnr", "edge")):
        assert scores[result] == pytest.approx(expected[name], abs=2e-3), name
