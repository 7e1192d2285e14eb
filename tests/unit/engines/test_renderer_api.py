"""Programming interface of the renderer: disparity, threads, providers."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import onnxruntime
import pytest
from numpy.testing import assert_array_equal

from bokehnet.errors import ParameterError
from bokehnet.optics.coc import defocus_from_disparity
from bokehnet.render.renderer import BokehRenderer


def picture() -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(5)
    disparity = np.full((96, 120), 0.2, np.float32)
    disparity[20:70, 30:60] = 0.9
    return rng.random((96, 120, 3), dtype=np.float32), disparity


def test_disparity_blur_and_focus_define_the_defocus():
    image, disparity = picture()
    renderer = BokehRenderer("scatter")
    direct = renderer.render(image, disparity=disparity, blur=12, focus=0.2)
    assert_array_equal(direct.bokeh, renderer.render(image, defocus_from_disparity(disparity, 12, 0.2)).bokeh)


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
def test_incomplete_defocus_arguments_raise_an_error(arguments, message):
    with pytest.raises(ParameterError, match=message):
        BokehRenderer("scatter").render(picture()[0], **arguments)


@pytest.mark.parametrize("engine", ["rays", "hybrid", "fast"])
def test_eight_threads_share_one_renderer_and_give_the_same_bits(engine):
    image, disparity = picture()
    renderer = BokehRenderer(engine)
    blurs = [6 + number for number in range(8)]

    def work(blur: float) -> np.ndarray:
        return renderer.render(image, disparity=disparity, blur=blur, focus=0.9).bokeh

    sequential = [work(blur) for blur in blurs]
    with ThreadPoolExecutor(8) as pool:
        parallel = list(pool.map(work, blurs))
    for expected, bokeh in zip(sequential, parallel, strict=True):
        assert_array_equal(expected, bokeh)


def test_an_unknown_provider_is_named_in_the_error():
    with pytest.raises(ParameterError, match=r"provider: .*NoSuchProvider"):
        BokehRenderer("hybrid", providers=["NoSuchProvider"])


def test_session_options_reach_onnx_runtime(tmp_path):
    """ONNX Runtime writes the optimised graph if the session options request it."""
    options = onnxruntime.SessionOptions()
    options.optimized_model_filepath = str(tmp_path / "optimised.onnx")
    options.log_severity_level = 3
    BokehRenderer("hybrid", session_options=options)
    assert (tmp_path / "optimised.onnx").stat().st_size > 100_000


def test_warm_up_runs_all_kernels():
    """The first picture needs no further compilation: kernels serve all sizes."""
    from bokehnet.classical.layered.march.ray_marching import _march

    renderer = BokehRenderer("hybrid")
    renderer.warm_up()
    kernels = set(_march.machine_code)
    image, disparity = picture()
    renderer.render(image, disparity=disparity, blur=12, focus=0.2)
    assert set(_march.machine_code) == kernels != set()
