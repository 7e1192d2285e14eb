"""Pictures in bands of columns: the same as whole, where strips of rows do not fit. Authority: the whole."""

import re

import numpy as np
import pytest

from bokehnet.arrays.viewport import Viewport
from bokehnet.classical.base import ALIGNED
from bokehnet.classical.known_surfaces import KnownSurfaces
from bokehnet.engines.bands import even_bands
from bokehnet.engines.engine import Engine
from bokehnet.engines.options import RenderOptions
from bokehnet.engines.strips import cut, min_strip_bytes
from bokehnet.errors import ParameterError
from bokehnet.optics.aperture import Aperture


def test_bands_cover_every_column_once_with_a_halo():
    bands = even_bands(2100, 300, 4)
    columns = [column for band in bands for column in range(band.start, band.stop)]
    assert columns == list(range(2100))
    for band in bands:
        assert band.first % ALIGNED == 0
        assert band.first == 0 or band.start - band.first >= 300
        assert band.last == 2100 or band.last - band.stop == 300


def own_fraction(reach: int, memory: int) -> tuple[float, int]:
    """Return rendered over read pixels of 100 megapixels, and the number of bands of a strip."""
    strips = [*cut((11180, 8944), reach, "rays", memory, bands=True)]
    tiles = [tile for bands in strips for tile in bands]
    read = sum((tile.last - tile.first) * (tile.right - tile.left) for tile in tiles)
    own = sum(
        (rows.stop - rows.start) * (columns.stop - columns.start)
        for rows, columns in (tile.output(8944) for tile in tiles)
    )
    assert own == 11180 * 8944
    return own / read, len(strips[0])


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
    assert fraction > 0.1
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
