"""Compositing of thesis 000, 5.1.2 and 5.1.4."""

import numpy as np
import pytest

from bokehnet.baselines.gather.scatter_as_you_gather import jimenez
from bokehnet.baselines.rays.breda_compositing import combined_factor, in_focus_diameter, split_fields
from bokehnet.baselines.rays.selective_rays import RaySelection, selective_rays
from bokehnet.classical.scatter_renderer import scatter_inside as scatter
from tests.unit.baselines.rays.test_selective_rays import LENS, PITCH, pinhole, rms, trace_rays, truth

# Methods of the literature, which no default uses: their kernels are compiled for the tests.
pytestmark = pytest.mark.slow


def lerp(a, b, t):
    return a + (b - a) * t


def test_the_factor_is_the_listing_line_by_line():
    """Authority: the listing of 5.1.2, for single numbers."""
    rng = np.random.default_rng(0)
    for coc, largest, behind, focus, alpha in rng.random((50, 5)) * [2, 8, 1, 3, 1]:
        delta = min(max(1.0 - focus * behind, 0.0), 1.0)
        foreground = lerp(largest, coc, delta)
        expected = min(max(lerp(coc, foreground, alpha), 0.0), 1.0)
        result = combined_factor(*(np.array(x) for x in (coc, largest, behind)), focus, np.array(alpha))
        assert result == pytest.approx(expected)


def test_the_printed_factor_depends_on_the_scale_of_the_scene():
    """The misprint: a scene in other units has other weights, while every blur stays."""
    numbers = np.array(0.2), np.array(4.0)
    one = combined_factor(*numbers, np.array(0.5), 1.0, np.array(0.5))
    larger = combined_factor(*numbers, np.array(5.0), 10.0, np.array(0.5))
    assert abs(float(one) - float(larger)) > 0.03 or (one == 1.0 and larger == 1.0)
    assert combined_factor(np.array(0.1), np.array(1.0), np.array(0.5), 1.0, np.array(0.5)) != (
        combined_factor(np.array(0.1), np.array(1.0), np.array(5.0), 10.0, np.array(0.5))
    )


def test_c_as_printed_leaves_nothing_in_focus():
    """0.2 mm times the pitch of a sensor of 36 mm and 1200 pixels is 0.2 thousandths of a pixel."""
    aperture, focal, focus, pitch = 50e-3 / 3.5, 50e-3, 6.0, 36e-3 / 1200
    near = aperture * focal * focus / (aperture * focal + 0.2e-3 * (focus - focal) * pitch)
    coc_px = aperture * focal * (focus - near) / (near * (focus - focal)) / pitch
    assert coc_px == pytest.approx(0.2e-3)
    assert in_focus_diameter(1200) == pytest.approx(0.8)


def test_fields_are_composited_to_a_wall_without_a_seam():
    """Authority: a wall of one colour stays; coverage of a half plane falls from 1 to 0 around its edge."""
    image, depth, _ = pinhole()
    defocus = np.where(depth < 2000, 6.0, 0.0).astype(np.float32)
    near, far, coverage = split_fields(np.ones_like(image, np.float32), defocus, scatter)
    assert np.abs(near - 1).max() < 1e-3
    assert np.abs(far - 1).max() < 1e-3
    row = coverage[16]
    assert row[4] > 0.95
    assert row[40] < 0.05
    assert (np.diff(row) <= 1e-5).all()


def test_both_rules_against_distributed_rays():
    """Authority: a distribution tracer; separate fields gain, the compositing of breda loses."""
    image, depth, normals = pinhole()
    exact = truth()
    common = {"mask": "reach", "frames": 8, "max_rays": 8}
    results = {
        rule: selective_rays(
            image,
            depth,
            normals,
            trace_rays,
            LENS,
            PITCH,
            RaySelection(rule=rule, post_process=post, **common),
        )
        for rule, post in (("breda", jimenez), ("fields", scatter))
    }
    near = results["fields"].rays > 0
    post = rms(results["breda"].post_process[near], exact[near])
    breda, fields = (rms(result.bokeh[near], exact[near]) for result in results.values())
    assert fields < 0.5 * post
    assert breda > post  # the wall is in focus, so it stays sharp under the card's blur


def test_jitter_moves_taps_and_keeps_flat_areas():
    rng = np.random.default_rng(1)
    image = rng.random((64, 64, 3)).astype(np.float32)
    defocus = np.full((64, 64), 8.0, np.float32)
    plain, jittered = jimenez(image, defocus), jimenez(image, defocus, jitter=1.0)
    assert (plain != jittered).any()
    flat = np.full_like(image, 0.4)
    assert np.abs(jimenez(flat, defocus, jitter=1.0) - 0.4).max() < 1e-5
