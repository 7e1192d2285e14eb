"""Pictures in strips: the same as whole, in bounded memory."""

import numpy as np
import pytest

from bokehnet.classical.base import ALIGNED
from bokehnet.errors import ParameterError
from bokehnet.inference.pipeline import BokehRenderer
from bokehnet.inference.strips import BYTES_PER_PIXEL, cut_strips
from bokehnet.optics.aperture import Aperture


def tall_picture(height: int = 900, width: int = 120) -> tuple[np.ndarray, np.ndarray]:
    """Posts of several depths before a slope, with lights; largest radius 14 px."""
    rng = np.random.default_rng(3)
    image = np.repeat(np.repeat(rng.random((height // 4, width // 4, 3), dtype=np.float32), 4, 0), 4, 1)
    image[rng.integers(0, height, 20), rng.integers(0, width, 20)] = 60
    defocus = np.linspace(-9, -3, height, dtype=np.float32)[:, None].repeat(width, 1)
    for number, top in enumerate(range(30, height, 110)):
        defocus[top : top + 60, 20 + 7 * number :][:, :25] = (14.0, 5.0, 0.0)[number % 3]
    return image, defocus


def test_strips_cover_every_row_once():
    strips = [*cut_strips(1000, 80, 10, "rays", 600 * 80 * BYTES_PER_PIXEL["rays"])]
    rows = [row for s in strips for row in range(s.first + s.wanted.start, s.first + s.wanted.stop)]
    assert rows == list(range(1000))
    assert len(strips) > 2
    for strip in strips:
        assert strip.first % ALIGNED == 0
        assert strip.first == 0 or strip.wanted.start >= 20
        assert strip.last == 1000 or strip.last - strip.first - strip.wanted.stop >= 20
        assert (strip.last - strip.first) <= 600


@pytest.mark.parametrize("engine", ["rays", "scatter", "hybrid"])
def test_strips_give_the_whole_picture(engine):
    """Issue's bound: 60 dB; each strip ends inside posts, slope and lights' discs."""
    image, defocus = tall_picture()
    renderer = BokehRenderer(engine)
    memory = 520 * image.shape[1] * BYTES_PER_PIXEL["scatter" if engine == "scatter" else "rays"]
    whole, parts = renderer.render(image, defocus), renderer.render(image, defocus, max_memory=memory)
    assert 10 * np.log10(1 / max(np.mean((whole.bokeh - parts.bokeh) ** 2), 1e-20)) > 60
    assert np.abs(whole.error_map - parts.error_map).max() < 1e-3
    assert (parts.classical is None) == (engine == "hybrid")


def test_a_picture_that_fits_is_rendered_whole():
    image, defocus = tall_picture(128, 60)
    whole = BokehRenderer("rays").render(image, defocus)
    assert np.array_equal(whole.bokeh, BokehRenderer("rays").render(image, defocus, max_memory=2**30).bokeh)


def test_progress_counts_the_strips():
    image, defocus = tall_picture()
    calls: list[tuple[int, int]] = []
    BokehRenderer("scatter").render(
        image, defocus, lambda done, total: calls.append((done, total)), max_memory=2_830_000
    )
    assert calls[0][0] == 0
    assert calls[-1][0] == calls[-1][1] > 2
    assert [done for done, _ in calls] == sorted(done for done, _ in calls)


def test_too_little_memory_tells_how_much_it_takes():
    image, defocus = tall_picture()
    with pytest.raises(
        ParameterError, match=r"max_memory: expected at least 6 MB .* width of 120 .* 14 pixels"
    ):
        BokehRenderer("rays").render(image, defocus, max_memory=1000)


def test_a_cats_eye_is_not_cut():
    image, defocus = tall_picture()
    renderer = BokehRenderer("rays", aperture=Aperture(cats_eye=0.5))
    with pytest.raises(ParameterError, match="max_memory: a cat's-eye needs the whole picture"):
        renderer.render(image, defocus, max_memory=520 * 120 * BYTES_PER_PIXEL["rays"])
