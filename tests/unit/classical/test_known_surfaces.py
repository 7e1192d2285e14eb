"""Known surfaces: what is refused, cut and joined; and what rays make of them.

Authority: composited discs in closed form.
"""

from dataclasses import replace

import numpy as np
import pytest

from bokehnet.classical.known_surfaces import KnownSurfaces, concatenate_surfaces
from bokehnet.classical.rays_renderer import rays, render_rays
from bokehnet.engines.engine import Engine
from bokehnet.engines.options import RenderOptions
from bokehnet.engines.strips import strip_bytes
from bokehnet.errors import ParameterError, ShapeError
from bokehnet.optics.aperture import Aperture
from bokehnet.optics.tone import gamma_curve


def wire(height=40, width=64, column=32, coverage=0.25, near=8.0, shade=(0.0, 0.2, 0.0), **more):
    """A thin wire before a grey wall, too thin for any pixel of the map to show it."""
    rows = np.arange(height)
    ones = np.ones(height, np.float32)
    known = KnownSurfaces(
        rows=rows,
        columns=np.full(height, column),
        near=near * ones,
        far=0 * ones,
        coverage=coverage * ones,
        front=np.tile(np.float32(shade), (height, 1)),
        back=np.full((height, 3), 0.8, np.float32),
        complete=True,
        **more,
    )
    image = np.full((height, width, 3), 0.8, np.float32)
    image[:, column] = coverage * np.float32(shade) + (1 - coverage) * 0.8
    return image, np.zeros((height, width), np.float32), known


def test_a_wire_that_no_pixel_of_the_map_shows_is_blurred():
    """Each pixel sees as much of the wire as a disc of 8 pixels has of it in its column: a chord.

    What the rays show on average is looked at: the noise of a single picture is larger than the bound.
    """
    image, defocus, known = wire()
    result = np.mean([rays(image, defocus, known=known, seed=seed)[12:28] for seed in range(4)], axis=(0, 1))
    away = np.arange(64)[:, None] - 32 + np.linspace(-0.5, 0.5, 101)  # a wire as wide as its pixel
    chord = (2 * np.sqrt(np.maximum(64 - away**2, 0)) / (np.pi * 64)).mean(1)
    share = 0.25 * chord[:, None]
    truth = 0.8 * (1 - share) + share * np.array([0.0, 0.2, 0.0])
    np.testing.assert_allclose(result, truth, atol=0.004)
    assert np.abs(rays(image, defocus) - image).max() < 1e-6  # without, the wire stays where it is, sharp


def test_a_sharp_front_before_a_blurred_wall_keeps_its_coverage():
    """A wall of one colour is that colour however it is blurred, so a pixel shows ``a F + (1 - a) B``."""
    rng = np.random.default_rng(5)
    coverage = rng.uniform(0.1, 0.9, 30).astype(np.float32)
    defocus = np.where(np.arange(40) < 20, 0.0, -9.0).astype(np.float32)
    image = np.where(np.arange(40)[:, None] < 20, (0.9, 0.1, 0.3), (0.1, 0.7, 0.5)).astype(np.float32)
    image, defocus = np.tile(image, (30, 1, 1)), np.tile(defocus, (30, 1))
    front, back = image[:, 0].copy(), image[:, -1].copy()
    image[:, 20] = coverage[:, None] * front + (1 - coverage[:, None]) * back
    zeros = np.zeros(30, np.float32)
    known = KnownSurfaces(
        rows=np.arange(30),
        columns=np.full(30, 20),
        near=zeros,
        far=zeros - 9,
        coverage=coverage,
        front=front,
        back=back,
        complete=True,
    )
    error = np.abs(rays(image, defocus, known=known) - image).max()
    assert error < 0.02 < 2 * np.abs(rays(image, defocus) - image).max()
    held = rays(image, defocus, known=known.without_colors())
    assert np.abs(held - image).max() < 0.06


def test_unmixed_pixels_are_reported():
    image, defocus, known = wire()
    picture = render_rays(image, defocus, known=known).mixed_pixels
    assert picture is not None
    for name in ("rows", "columns", "near", "far", "coverage", "front", "back"):
        np.testing.assert_array_equal(getattr(picture, name), getattr(known, name))
    assert render_rays(image, defocus, known=replace(known, near=known.far + 0.5)).mixed_pixels is None


@pytest.mark.parametrize("engine", ["rays", "hybrid", "scatter"])
def test_strips_take_what_is_known_of_their_rows(engine):
    """Decibels against the whole picture."""
    image, defocus, known = wire(height=900, width=96, near=12.0)
    image = image * np.random.default_rng(1).uniform(0.5, 1, (900, 96, 1)).astype(np.float32)
    renderer = Engine(engine)
    memory = strip_bytes((900, 96), (256, 96), 12, "rays")
    whole = renderer.render(image, defocus, options=RenderOptions(known=known))
    parts = renderer.render(image, defocus, options=RenderOptions(known=known, max_memory=memory))
    assert np.mean((whole.bokeh - parts.bokeh) ** 2) < 1e-6
    if engine == "rays":
        assert whole.largest_blur == parts.largest_blur == 12
        np.testing.assert_array_equal(whole.mixed_pixels.rows, parts.mixed_pixels.rows)


def test_gamma_weighs_the_known_colours_as_it_weighs_the_picture():
    """A sharp wire before a blurred wall of one colour: ``decode(a encode(F) + (1 - a) encode(B))``."""
    image, defocus, known = wire(near=0.0)
    known, defocus = replace(known, far=known.far - 6), defocus - 6
    picture = (
        Engine("rays").render(image, defocus, options=RenderOptions(known=known, gamma=2.0)).bokeh[20, 32]
    )
    curve = gamma_curve(image, 2.0)
    front, back = (curve.encode(side[:1])[0] for side in (known.front, known.back))
    np.testing.assert_allclose(picture, curve.decode(0.25 * front + 0.75 * back), atol=0.01)


def test_rows_are_cut_and_joined_again():
    known = wire()[2]
    parts = [known.in_rows(first, first + 10).below(first) for first in range(0, 40, 10)]
    again = concatenate_surfaces(parts)
    assert again is not None
    np.testing.assert_array_equal(again.rows, known.rows)
    np.testing.assert_array_equal(again.front, known.front)
    assert concatenate_surfaces([]) is None
    assert again.complete


@pytest.mark.parametrize(
    ("change", "error", "message"),
    [
        ({"coverage": [2.0, 0.5]}, ParameterError, "known coverage: expected 0 to 1, got 0.5 to 2"),
        ({"coverage": [np.nan, 0.5]}, ParameterError, "known coverage: expected finite values"),
        ({"near": [-1.0, 5.0]}, ParameterError, "known far: expected values not above `near`"),
        ({"rows": [1, 0]}, ParameterError, "known rows: expected pixels in row order"),
        ({"columns": [3, 3], "rows": [1, 1]}, ParameterError, "known rows: expected pixels in row order"),
        ({"rows": [-1, 0]}, ParameterError, "known rows: expected rows and columns from 0 up"),
        ({"rows": [0.5, 1]}, ShapeError, "known rows: expected 2 whole numbers"),
        ({"far": [1.0]}, ShapeError, r"known far: expected shape \(2,\), got \(1,\)"),
        ({"front": None}, ParameterError, "known front: expected colors of both surfaces or of none"),
    ],
)
def test_what_does_not_go_together_is_refused(change, error, message):
    good = {
        "rows": [0, 1],
        "columns": [3, 3],
        "near": [5.0, 5.0],
        "far": [0.0, 0.0],
        "coverage": [0.5, 0.5],
        "front": np.ones((2, 3)),
        "back": np.ones((2, 3)),
    }
    options = {name: None if value is None else np.asarray(value) for name, value in (good | change).items()}
    with pytest.raises(error, match=message):
        KnownSurfaces(**options)


def test_pixels_outside_the_picture_are_refused():
    image, defocus, known = wire()
    with pytest.raises(ParameterError, match="known rows: expected pixels of a picture of 64x20"):
        rays(image[:20], defocus[:20], known=known)
    with pytest.raises(ParameterError, match="known: expected KnownSurfaces or None"):
        Engine("rays").render(image, defocus, options=RenderOptions(known="all"))


@pytest.mark.parametrize("shape", [(1, 1), (1, 9), (9, 1), (6, 6)])
def test_small_pictures_and_pictures_that_are_all_edge(shape):
    rng = np.random.default_rng(2)
    count = shape[0] * shape[1]
    y, x = np.divmod(np.arange(count), shape[1])
    far = rng.uniform(-9, 0, count)
    known = KnownSurfaces(
        rows=y,
        columns=x,
        near=far + rng.uniform(0, 9, count),
        far=far,
        coverage=rng.uniform(0, 1, count),
        front=rng.random((count, 3)),
        back=rng.random((count, 3)),
        complete=True,
    )
    image, defocus = rng.random((*shape, 3), dtype=np.float32), far.reshape(shape).astype(np.float32)
    for message in (known, known.without_colors(), known.select(np.zeros(count, bool))):
        assert np.isfinite(rays(image, defocus, aperture=Aperture(blades=5), known=message)).all()
