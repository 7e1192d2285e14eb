"""Pictures in strips: the same as whole, in bounded memory."""

import math
from dataclasses import replace

import numpy as np
import pytest

from bokehnet.arrays.viewport import Viewport
from bokehnet.classical.base import ALIGNED, with_halo
from bokehnet.classical.layered.march import resolution_levels
from bokehnet.classical.picture_job import output_halo
from bokehnet.engine_registry import CLASSICAL
from bokehnet.engines.engine import Engine
from bokehnet.engines.options import RenderOptions
from bokehnet.engines.strips import StripAccumulator, cut, strip_bytes, working_memory
from bokehnet.errors import ParameterError
from bokehnet.optics.aberrations.chromatic_aberration import ChromaticAberration
from bokehnet.optics.aberrations.lens_response import LensResponse
from bokehnet.optics.aberrations.sliders import AberrationSliders
from bokehnet.optics.aperture import Aperture
from bokehnet.render.renderer import BokehRenderer


def tall_picture(height: int = 900, width: int = 120) -> tuple[np.ndarray, np.ndarray]:
    """Posts of several depths before a slope, with lights; largest radius 14 px."""
    rng = np.random.default_rng(3)
    image = np.repeat(np.repeat(rng.random((height // 4, width // 4, 3), dtype=np.float32), 4, 0), 4, 1)
    image[rng.integers(0, height, 20), rng.integers(0, width, 20)] = 60
    defocus = np.linspace(-9, -3, height, dtype=np.float32)[:, None].repeat(width, 1)
    for number, top in enumerate(range(30, height, 110)):
        defocus[top : top + 60, 20 + 7 * number :][:, :25] = (14.0, 5.0, 0.0)[number % 3]
    return image, defocus


def memory_of_strips(defocus: np.ndarray, rows: int, classical: str) -> int:
    """Return the memory, bytes, of strips with so many own rows behind a perfect lens."""
    radius = math.ceil(float(np.abs(defocus).max()))
    return strip_bytes(defocus.shape, (rows, defocus.shape[1]), radius, classical)


def test_strips_cover_every_row_once():
    strips = [
        strip for (strip,) in cut((1000, 80), 10, "rays", strip_bytes((1000, 80), (384, 80), 10, "rays"))
    ]
    rows = [row for s in strips for row in range(s.first + s.output_rows.start, s.first + s.output_rows.stop)]
    assert rows == list(range(1000))
    assert len(strips) > 2
    for strip in strips:
        assert strip.first % ALIGNED == 0
        assert strip.first == 0 or strip.output_rows.start >= 20
        assert strip.last == 1000 or strip.last - strip.first - strip.output_rows.stop >= 20
        assert strip.output_rows.stop - strip.output_rows.start <= 384


@pytest.mark.parametrize(("own_rows", "count"), [(512, 2), (384, 3), (128, 8)])
def test_strips_read_about_equally_many_rows(own_rows, count):
    """Rows of a strip with halos, by arithmetic: (1000 + 2 (n - 1) halo) / n, and alignment of both ends."""
    memory = strip_bytes((1000, 80), (own_rows, 80), 10, "rays")
    rows = [strip.last - strip.first for (strip,) in cut((1000, 80), 10, "rays", memory)]
    assert len(rows) == count
    assert max(rows) - min(rows[:-1]) <= 2 * ALIGNED


@pytest.mark.parametrize(
    ("reach", "most"),
    [(39, 1.0), (98, 1.5), (138, 2.0), (403, None)],
)
def test_a_large_picture_takes_little_memory_where_that_costs_little(reach, most):
    """24 megapixels: so many GiB; few rows are looked at twice."""
    height, width = 5475, 4380
    memory = working_memory((height, width), reach, "rays")
    assert (memory and memory / 2**30) == most
    if memory is not None:
        strips = [strip for (strip,) in cut((height, width), reach, "rays", memory)]
        spec = CLASSICAL["rays"]
        for strip in strips:
            rows = with_halo(strip.output_rows, output_halo(reach), strip.last - strip.first)
            reached, read = rows.stop - rows.start, strip.last - strip.first
            used = width * (spec.bytes_per_pixel * reached + spec.halo_bytes_per_pixel * read)
            assert used <= memory
        assert sum(strip.last - strip.first for strip in strips) < 1.4 * height
    assert working_memory((1350, 1080), reach, "rays") is None


GLASS = AberrationSliders(coma=3.0, field_curvature=2.0).aberration_map()


@pytest.mark.parametrize(
    ("engine", "lens_response", "bound"),
    [
        ("rays", None, 60),
        ("scatter", None, 60),
        ("hybrid", None, 60),
        ("rays", LensResponse(aberration_map=GLASS), 60),
        ("hybrid", LensResponse(aberration_map=replace(GLASS, tilt=(0.1, 0.05))), 60),
        ("rays", LensResponse(chromatic_aberration=ChromaticAberration(axial=1.0)), 60),
        # All lights of a strip share what their discs may cost: with fewer, these are finer.
        ("rays", LensResponse(chromatic_aberration=ChromaticAberration(axial=1.0, lateral=1.0)), 50),
    ],
)
def test_strips_give_the_whole_picture(engine, lens_response, bound):
    """Decibels; each strip ends inside posts, slope and lights' discs."""
    image, defocus = tall_picture()
    renderer = BokehRenderer(engine, lens_response=lens_response)
    memory = memory_of_strips(defocus, 256, "scatter" if engine == "scatter" else "rays")
    whole, parts = (
        renderer.render_arrays(image, defocus),
        renderer.render_arrays(image, defocus, options=RenderOptions(max_memory=memory)),
    )
    assert 10 * np.log10(1 / max(np.mean((whole.bokeh - parts.bokeh) ** 2), 1e-20)) > bound
    assert np.abs(whole.error_map - parts.error_map).max() < 1e-3
    assert (parts.classical is None) == (engine == "hybrid")


@pytest.mark.parametrize("radius", [20.0, 34.0, 66.0])
def test_strips_choose_the_sizes_of_the_whole_picture(radius):
    """Rays march at one and two smaller sizes where everything is blurred; decibels.

    Tiles of the smaller sizes at the joint of two strips may draw other numbers of rays: noise of few pixels.
    """
    image, defocus = tall_picture(1100, 72)
    posts = np.arange(1100)[:, None] // 96 % 3 == 0
    defocus = np.where(posts, radius, np.where(defocus > 10, 0.0, -radius)).astype(np.float32)
    defocus[300:900] = np.where(posts, radius, -radius)[300:900]
    renderer = BokehRenderer("rays")
    memory = memory_of_strips(defocus, 384, "rays")
    whole = renderer.render_arrays(image, defocus)
    parts = renderer.render_arrays(image, defocus, options=RenderOptions(max_memory=memory))
    assert 10 * np.log10(1 / max(np.mean((whole.bokeh - parts.bokeh) ** 2), 1e-20)) > 75
    assert np.abs(whole.bokeh - parts.bokeh).max() < 0.5 / 255


@pytest.mark.parametrize("field_curvature", [2.0, 6.0])
def test_strips_choose_the_sizes_of_the_whole_picture_behind_an_aberrated_lens(monkeypatch, field_curvature):
    """Rays march at smaller sizes, fewer towards the corners and near a band in focus; decibels."""
    image, _ = tall_picture(1664, 96)
    posts, left = np.arange(1664)[:, None] // 96 % 3 == 0, np.arange(96) < 48
    defocus = np.where(posts, 1.0, -1.0) * np.where(left, 40.0, 60.0)
    defocus[820:840] = 0.0
    defocus = defocus.astype(np.float32)
    aberration_map = AberrationSliders(coma=3.0, field_curvature=field_curvature).aberration_map()
    renderer = BokehRenderer("rays", lens_response=LensResponse(aberration_map=aberration_map))
    memory = memory_of_strips(defocus, 384, "rays")
    whole = renderer.render_arrays(image, defocus)
    parts = renderer.render_arrays(image, defocus, options=RenderOptions(max_memory=memory))
    assert 10 * np.log10(1 / max(np.mean((whole.bokeh - parts.bokeh) ** 2), 1e-20)) > 75
    monkeypatch.setattr(resolution_levels, "MAX_LEVELS", 0)
    assert not np.array_equal(renderer.render_arrays(image, defocus).bokeh, whole.bokeh)


def test_a_picture_that_fits_is_rendered_whole():
    image, defocus = tall_picture(128, 60)
    whole = BokehRenderer("rays").render_arrays(image, defocus)
    assert np.array_equal(
        whole.bokeh,
        BokehRenderer("rays").render_arrays(image, defocus, options=RenderOptions(max_memory=2**30)).bokeh,
    )


def test_progress_counts_the_strips():
    image, defocus = tall_picture()
    calls: list[tuple[int, int]] = []
    BokehRenderer("scatter").render_arrays(
        image,
        defocus,
        lambda done, total: calls.append((done, total)),
        options=RenderOptions(max_memory=2_830_000),
    )
    assert calls[0][0] == 0
    assert calls[-1][0] == calls[-1][1] > 2
    assert [done for done, _ in calls] == sorted(done for done, _ in calls)


def test_too_little_memory_names_the_minimum():
    image, defocus = tall_picture()
    with pytest.raises(
        ParameterError, match=r"max_memory: expected at least 7 MB .* width of 120 .* 14 pixels"
    ):
        BokehRenderer("rays").render_arrays(image, defocus, options=RenderOptions(max_memory=1000))


@pytest.mark.parametrize("engine", ["rays", "scatter", "fast"])
@pytest.mark.parametrize("shape", [{}, {"blades": 5}])
def test_a_cats_eye_in_strips_gives_the_whole_picture(engine, shape):
    image, defocus = tall_picture()
    renderer = BokehRenderer(engine, aperture=Aperture(cats_eye=0.9, **shape))
    memory = memory_of_strips(defocus, 256, "rays" if engine == "rays" else "scatter")
    whole, parts = (
        renderer.render_arrays(image, defocus),
        renderer.render_arrays(image, defocus, options=RenderOptions(max_memory=memory)),
    )
    assert 10 * np.log10(1 / max(np.mean((whole.bokeh - parts.bokeh) ** 2), 1e-20)) > 60


COLOURS = LensResponse(chromatic_aberration=ChromaticAberration(axial=1.0, lateral=2.0))


@pytest.mark.parametrize(
    ("engine", "aperture", "lens_response"),
    [
        ("scatter", Aperture(cats_eye=0.9), None),
        ("rays", Aperture(cats_eye=0.9), None),
        ("rays", Aperture(), LensResponse(aberration_map=GLASS)),
        ("rays", Aperture(), COLOURS),
    ],
)
def test_a_data_window_off_the_middle_is_blurred_as_in_the_whole_picture(engine, aperture, lens_response):
    """Authority: the whole picture, cut; the noise of rays is another one."""
    image, defocus = tall_picture(520, 240)
    image = np.minimum(image, 4)
    top, left = 256, 128
    lens = {"aperture": aperture, "lens_response": lens_response}
    whole = Engine(engine).render(image, defocus, options=RenderOptions(**lens)).bokeh
    cut = (image[top:, left:], defocus[top:, left:])
    placed = (
        Engine(engine)
        .render(
            *cut, options=RenderOptions(**lens, viewport=Viewport(left=left, top=top, width=240, height=520))
        )
        .bokeh
    )
    alone = Engine(engine).render(*cut, options=RenderOptions(**lens)).bokeh
    inner = np.s_[32:-20, 32:-20]  # farther from the cut than any blur
    expected = whole[top:, left:][inner]
    error = [np.sqrt(np.mean((result[inner] - expected) ** 2)) for result in (placed, alone)]
    assert error[0] < (1e-5 if engine == "scatter" else 0.02)
    assert error[1] > 1.5 * error[0]


@pytest.mark.parametrize("engine", ["rays", "scatter"])
def test_overscan_is_blurred_as_if_it_were_not_there(engine):
    """Authority: the shown picture alone, away from its border."""
    image, defocus = tall_picture(384, 240)
    image = np.minimum(image, 4)
    lens = {"aperture": Aperture(cats_eye=0.9)}
    if engine == "rays":
        lens["lens_response"] = LensResponse(aberration_map=GLASS)
    shown = np.s_[128:-128, 32:-32]
    larger = (
        Engine(engine)
        .render(
            image,
            defocus,
            options=RenderOptions(**lens, viewport=Viewport(left=-32, top=-128, width=176, height=128)),
        )
        .bokeh
    )
    alone = Engine(engine).render(image[shown], defocus[shown], options=RenderOptions(**lens)).bokeh
    inner = np.s_[20:-20, 20:-20]
    error = np.sqrt(np.mean((larger[shown][inner] - alone[inner]) ** 2))
    assert error < (1e-5 if engine == "scatter" else 0.03)


@pytest.mark.parametrize("engine", ["rays", "scatter", "hybrid"])
def test_the_result_may_take_the_place_of_what_was_given(engine):
    """Oracle: the same strips beside their input, bit for bit."""
    image, defocus = tall_picture()
    image[:5] = -0.5  # counts as 0
    memory = memory_of_strips(defocus, 256, "scatter" if engine == "scatter" else "rays")
    renderer = BokehRenderer(engine)
    before = image.copy(), defocus.copy()
    separate = renderer.render_arrays(image, defocus, options=RenderOptions(max_memory=memory))
    assert np.array_equal(image, before[0])
    assert np.array_equal(defocus, before[1])
    over = renderer.render_arrays(image, defocus, options=RenderOptions(max_memory=memory, overwrite=True))
    assert over.bokeh is image
    assert over.error_map is defocus
    assert np.array_equal(over.bokeh, separate.bokeh)
    assert np.array_equal(over.error_map, separate.error_map)


def test_networks_on_the_scatter_read_the_defocus_again_so_it_stays():
    """Oracle: the same strips beside their input, bit for bit."""
    image, defocus = tall_picture()
    before = defocus.copy()
    memory = memory_of_strips(defocus, 256, "scatter")
    renderer = BokehRenderer("fast")
    separate = renderer.render_arrays(image, defocus, options=RenderOptions(max_memory=memory))
    over = renderer.render_arrays(
        image, defocus, options=RenderOptions(max_memory=memory + defocus.nbytes, overwrite=True)
    )
    assert over.bokeh is image
    assert np.array_equal(defocus, before)
    assert np.array_equal(over.bokeh, separate.bokeh)
    assert np.array_equal(over.error_map, separate.error_map)


def test_what_cannot_be_written_to_is_left_alone():
    image, defocus = tall_picture()
    defocus.flags.writeable = False
    before = defocus.copy()
    memory = memory_of_strips(defocus, 256, "scatter")
    result = BokehRenderer("scatter").render_arrays(
        image, defocus, options=RenderOptions(max_memory=memory, overwrite=True)
    )
    assert result.bokeh is image
    assert np.array_equal(defocus, before)
    assert result.error_map.max() > 0


def test_memory_that_is_taken_counts():
    """The remaining memory decides: the same strips, and the minimum includes all memory."""
    left = strip_bytes((1000, 80), (384, 80), 10, "rays")
    assert [*cut((1000, 80), 10, "rays", left + 10**9, 10**9)] == [*cut((1000, 80), 10, "rays", left)]
    with pytest.raises(ParameterError, match="max_memory: expected at least 1005 MB in all"):
        [*cut((1000, 80), 10, "rays", 10**9, 10**9)]


def test_rows_wait_until_no_later_strip_reads_them():
    """Three strips of 4 rows that read two rows more on either side."""
    read = np.arange(12.0)[:, None].repeat(2, 1)
    gathered = StripAccumulator(read, overwrite=True)
    for first, read_from in ((0, 2), (4, 6), (8, 12)):
        gathered.add(first, np.full((4, 2), -1.0 - first), read_from)
        assert (read[read_from:] == np.arange(12.0)[read_from:, None]).all()
        assert (read[:read_from] < 0).all()
    assert gathered.array is read
    assert read[:, 0].tolist() == [-1.0] * 4 + [-5.0] * 4 + [-9.0] * 4
