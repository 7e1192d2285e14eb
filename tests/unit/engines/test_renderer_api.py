"""The renderer as developers call it: disparity, threads, providers."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import onnxruntime
import pytest
from numpy.testing import assert_array_equal

from bokehnet.engines.options import RenderOptions
from bokehnet.errors import ParameterError
from bokehnet.optics.aperture import Aperture
from bokehnet.optics.coc import defocus_from_disparity
from bokehnet.render.renderer import BokehRenderer


def picture() -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(5)
    disparity = np.full((96, 120), 0.2, np.float32)
    disparity[20:70, 30:60] = 0.9
    return rng.random((96, 120, 3), dtype=np.float32), disparity


def test_disparity_blur_and_focus_are_a_defocus():
    image, disparity = picture()
    renderer = BokehRenderer("scatter")
    direct = renderer.render_arrays(image, disparity=disparity, blur=12, focus=0.2)
    assert_array_equal(
        direct.bokeh, renderer.render_arrays(image, defocus_from_disparity(disparity, 12, 0.2)).bokeh
    )


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({}, "defocus: expected either this, or `disparity`, `blur` and `focus`"),
        (
            {"disparity": np.zeros((96, 120))},
            "blur: expected a value, as .* give `blur` and `focus`, or `defocus` alone",
        ),
        ({"defocus": np.zeros((96, 120)), "blur": 3.0}, "got both"),
        ({"disparity": np.zeros((96, 120)), "blur": -1.0, "focus": 0.5}, "blur: expected at least 0"),
        ({"disparity": np.zeros((96, 120)), "blur": 1.0, "focus": np.nan}, "focus: expected a finite number"),
    ],
)
def test_half_a_defocus_is_refused(arguments, message):
    with pytest.raises(ParameterError, match=message):
        BokehRenderer("scatter").render_arrays(picture()[0], **arguments)


@pytest.mark.parametrize("names", [("max_memory", "memory_in_use"), ("max_memory", "memory_taken")])
def test_the_deprecated_call_with_arrays_gives_the_same_bits(names):
    """Oracle: ``render_arrays``; also with the keyword of version 0.1."""
    image, disparity = picture()
    renderer = BokehRenderer("scatter")
    distances = {"disparity": disparity, "blur": 12, "focus": 0.2}
    options = {"gamma": 2.0, **dict(zip(names, (2**30, 2**20), strict=True))}
    expected = renderer.render_arrays(
        image, **distances, options=RenderOptions(gamma=2.0, max_memory=2**30, memory_in_use=2**20)
    )
    with pytest.warns(DeprecationWarning, match="render_arrays"):
        result = renderer.render(image, **distances, **options)
    assert_array_equal(result.bokeh, expected.bokeh)
    with pytest.warns(DeprecationWarning, match="render_arrays"):
        result = renderer.render(image=image, defocus=defocus_from_disparity(disparity, 12, 0.2))
    assert_array_equal(result.bokeh, renderer.render_arrays(image, **distances).bokeh)


def test_options_of_the_call_replace_those_of_the_renderer():
    """Oracle: a renderer with that aperture."""
    image, disparity = picture()
    blades, arrays = Aperture(blades=5), {"disparity": disparity, "blur": 12, "focus": 0.2}
    expected = BokehRenderer("scatter", aperture=blades).render_arrays(image, **arrays).bokeh
    result = BokehRenderer("scatter").render_arrays(image, **arrays, options=RenderOptions(aperture=blades))
    assert_array_equal(result.bokeh, expected)
    with pytest.raises(ParameterError, match="options: expected RenderOptions or None"):
        BokehRenderer("scatter").render_arrays(image, **arrays, options={"gamma": 2})


@pytest.mark.parametrize("wrong", ["photo.png", None, 5])
def test_only_scenes_are_rendered_with_settings(wrong):
    with pytest.raises(ParameterError, match="scene: expected Scene or FocusedScene"):
        BokehRenderer("scatter").render(wrong)


@pytest.mark.parametrize("engine", ["rays", "hybrid", "fast"])
def test_eight_threads_share_one_renderer_and_give_the_same_bits(engine):
    image, disparity = picture()
    renderer = BokehRenderer(engine)
    blurs = [6 + number for number in range(8)]

    def work(blur: float) -> np.ndarray:
        return renderer.render_arrays(image, disparity=disparity, blur=blur, focus=0.9).bokeh

    alone = [work(blur) for blur in blurs]
    with ThreadPoolExecutor(8) as pool:
        together = list(pool.map(work, blurs))
    for one, other in zip(alone, together, strict=True):
        assert_array_equal(one, other)


def test_an_unknown_provider_is_refused_by_name():
    with pytest.raises(ParameterError, match=r"provider: .*NoSuchProvider"):
        BokehRenderer("hybrid", providers=["NoSuchProvider"])


def test_session_options_are_handed_on(tmp_path):
    """ONNX Runtime writes the optimised graph of the session whose options ask for it."""
    options = onnxruntime.SessionOptions()
    options.optimized_model_filepath = str(tmp_path / "optimised.onnx")
    options.log_severity_level = 3
    BokehRenderer("hybrid", session_options=options)
    assert (tmp_path / "optimised.onnx").stat().st_size > 100_000


def test_warm_up_runs_every_part():
    """Nothing of it is left for the first picture: kernels are found, or compiled, once for all sizes."""
    from bokehnet.classical.layered.march.ray_marching import _march

    renderer = BokehRenderer("hybrid")
    renderer.warm_up()
    known = set(_march.machine_code)
    image, disparity = picture()
    renderer.render_arrays(image, disparity=disparity, blur=12, focus=0.2)
    assert set(_march.machine_code) == known != set()
