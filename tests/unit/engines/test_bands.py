"""Pictures in bands of columns: the same as whole, where strips of rows do not fit. Authority: the whole."""

import re

import numpy as np
import pytest

from bokehnet.arrays.viewport import Viewport
from bokehnet.classical import rays_renderer
from bokehnet.classical.base import ALIGNED, Strip
from bokehnet.classical.known_surfaces import KnownSurfaces
from bokehnet.classical.rays_renderer import render_rays
from bokehnet.classical.scatter_renderer import render_scatter
from bokehnet.engines.engine import Engine
from bokehnet.engines.options import RenderOptions
from bokehnet.engines.strips import cut, min_strip_bytes
from bokehnet.errors import ParameterError
from bokehnet.optics.aperture import Aperture


def own_fraction(reach: int, memory: int) -> tuple[float, int]:
    """Return rendered over read pixels of 100 megapixels, and the number of bands of a strip.

    Checks that blocks of 64x64 pixels are rendered once, with a halo of two radii on all sides.
    """
    height, width = 11180, 8944
    strips = [*cut((height, width), reach, "rays", memory, bands=True)]
    rendered, read = np.zeros((-(-height // 64), -(-width // 64)), int), 0
    for tile in (tile for bands in strips for tile in bands):
        (top, bottom), (left, right) = (
            (start + span.start, start + span.stop)
            for start, span in zip((tile.first, tile.left), tile.output, strict=True)
        )
        rendered[top // 64 : -(-bottom // 64), left // 64 : -(-right // 64)] += 1
        read += (tile.last - tile.first) * (tile.right - tile.left)
        assert tile.first % ALIGNED == tile.left % ALIGNED == 0
        assert tile.first <= max(0, top - 2 * reach)
        assert tile.left <= max(0, left - 2 * reach)
        assert tile.last >= min(height, bottom + 2 * reach)
        assert tile.right >= min(width, right + 2 * reach)
    assert (rendered == 1).all()
    return height * width / read, len(strips[0])


@pytest.mark.parametrize(("reach", "memory", "several"), [(40, 2 * 10**9, False), (311, 2 * 10**9, True)])
def test_bands_are_cut_only_where_strips_are_mostly_halo(reach, memory, several):
    fraction, bands = own_fraction(reach, memory)
    assert (bands > 1) == several
    assert fraction > (0.3 if several else 0.7)


def test_the_minimum_of_bands_is_enough_for_bands():
    minimum = min_strip_bytes((11180, 8944), 311, "rays", True)
    assert minimum < 0.7 * min_strip_bytes((11180, 8944), 311, "rays", False)
    fraction, bands = own_fraction(311, minimum)
    assert bands > 1
    assert fraction > 1 / 9
    with pytest.raises(ParameterError):
        own_fraction(311, minimum - 1)


def posts(height: int = 640, width: int = 900) -> tuple[np.ndarray, np.ndarray]:
    """Return posts and a leaning wall with radii up to 30 pixels, and a lamp."""
    rng = np.random.default_rng(3)
    image = np.repeat(np.repeat(rng.random((height // 4, width // 4, 3), dtype=np.float32), 4, 0), 4, 1)
    image[300, 500] = 60
    defocus = np.linspace(-30, -4, width, dtype=np.float32)[None].repeat(height, 0)
    for number, left in enumerate(range(40, width, 160)):
        defocus[60:580, left : left + 50] = (30.0, 8.0, 0.0)[number % 3]
    return image, defocus


# Bytes: 384 columns of their own and 640 rows fit, whole rows do not.
_MEMORY = 72_000_000


@pytest.mark.parametrize("overwrite", [False, True])
@pytest.mark.parametrize("aperture", [Aperture(), Aperture(cats_eye=0.9)])
def test_bands_give_the_whole_picture(overwrite, aperture, monkeypatch):
    """Decibels: rays of another band have other noise, of which two draws differ as much."""
    image, defocus = posts()
    engine = Engine("rays")
    whole = engine.render(image, defocus, options=RenderOptions(aperture=aperture))
    calls = []
    monkeypatch.setattr(
        Engine,
        "_render_bands",
        lambda *arguments, original=Engine._render_bands: (
            calls.append(len(arguments[2])),
            original(*arguments),
        )[1],
    )
    steps: list[tuple[int, int]] = []
    options = RenderOptions(aperture=aperture, max_memory=_MEMORY, overwrite=overwrite)
    parts = engine.render(
        image.copy(), defocus.copy(), lambda done, total: steps.append((done, total)), options=options
    )
    assert calls[0] > 1
    assert 10 * np.log10(1 / np.mean((np.clip(whole.bokeh, 0, 1) - np.clip(parts.bokeh, 0, 1)) ** 2)) > 50
    assert np.abs(whole.error_map - parts.error_map).max() < 1e-3
    assert abs(whole.bokeh.sum() / parts.bokeh.sum() - 1) < 1e-3
    assert steps == sorted(steps)
    assert steps[-1][0] == steps[-1][1]
    whole_surfaces, surfaces = whole.mixed_pixels, parts.mixed_pixels
    np.testing.assert_array_equal(surfaces.rows, whole_surfaces.rows)
    np.testing.assert_array_equal(surfaces.columns, whole_surfaces.columns)
    np.testing.assert_allclose(surfaces.coverage, whole_surfaces.coverage, atol=1e-3)


def test_the_halo_of_a_band_sends_no_rays(monkeypatch):
    """Pixels that send rays: those of the whole picture, and around each band what its windows average."""
    image, defocus = posts()
    sent = []

    def counted(job, *arguments, original=rays_renderer.march_levels):
        sent.append(np.count_nonzero(job.rays_mask))
        original(job, *arguments)

    monkeypatch.setattr(rays_renderer, "march_levels", counted)
    Engine("rays").render(image, defocus)
    whole = sent.pop()
    Engine("rays").render(image, defocus, options=RenderOptions(max_memory=_MEMORY))
    assert len(sent) > 2
    assert whole <= sum(sent) < 1.3 * whole


def test_scatter_has_no_bands():
    for bands in (False, True):
        minimum = min_strip_bytes((5475, 4380), 39, "scatter", bands)
        assert len(next(cut((5475, 4380), 39, "scatter", minimum, bands=bands))) == 1
        with pytest.raises(ParameterError):
            next(cut((5475, 4380), 39, "scatter", minimum - 1, bands=bands))


def test_a_strip_alone_knows_its_columns():
    """A cat's-eye differs from column to column: 37 dB if taken for that of the first columns.

    Authority: the whole picture, cut. The noise of rays differs.
    """
    image, defocus = posts()
    image = np.minimum(image, 2)
    strip = Strip(
        first=128,
        last=512,
        left=256,
        right=768,
        height=len(defocus),
        width=defocus.shape[1],
        max_coc_radius=30,
        max_ray_reach=30,
        output_rows=slice(128, 256),
        output_columns=slice(192, 320),
    )
    aperture = Aperture(cats_eye=0.9)
    for render, bound in ((render_rays, 42), (render_scatter, 80)):
        whole = render(image, defocus, aperture).bokeh[256:384, 448:576]
        part = render(image[128:512, 256:768], defocus[128:512, 256:768], aperture, strip=strip).bokeh
        assert part.shape == whole.shape
        assert 10 * np.log10(1 / np.mean((np.clip(whole, 0, 1) - np.clip(part, 0, 1)) ** 2)) > bound


def test_a_bound_below_the_minimum_of_bands_names_it():
    image, defocus = posts()
    minimum = min_strip_bytes(defocus.shape, 30, "rays", True)
    with pytest.raises(ParameterError, match=r"at least \d+ MB") as error:
        Engine("rays").render(image, defocus, options=RenderOptions(max_memory=10**7))
    match = re.search(r"at least (\d+) MB", str(error.value))
    assert match is not None
    assert int(match[1]) == np.ceil(minimum / 1e6)


def test_known_surfaces_are_cut_by_columns():
    known = KnownSurfaces(
        rows=np.array([1, 1, 4]),
        columns=np.array([3, 9, 5]),
        near=np.float32([1, 2, 3]),
        far=np.float32([0, 0, 0]),
        coverage=np.float32([0.5, 0.25, 0.75]),
    )
    part = known.in_columns(4, 10, -4)
    assert part.rows.tolist() == [1, 4]
    assert part.columns.tolist() == [5, 1]
    assert part.near.tolist() == [2, 3]


def test_the_axis_stays_where_it_is():
    """Field positions of a band are those of the whole picture: a viewport moved by its first column."""
    viewport = Viewport(left=256, width=900, height=640)
    assert viewport.frame.column == 0.5 * 899 - 256
