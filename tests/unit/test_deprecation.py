"""Earlier names of public attributes warn and give what the present name gives."""

import numpy as np
import pytest

from bokehnet.arrays.viewport import Viewport
from bokehnet.classical.known_layers import Layers
from bokehnet.engines.engine import Engine
from bokehnet.io.image import write_image
from bokehnet.lenses import load_lens
from bokehnet.optics.aberrations.lens_response import LensResponse


def test_an_earlier_attribute_warns_and_works():
    lens = load_lens("double_gauss")
    with pytest.warns(DeprecationWarning, match="fastest is now min_f_number"):
        assert lens.fastest == lens.min_f_number
    with pytest.warns(DeprecationWarning, match="is_plain is now is_ideal"):
        assert LensResponse().is_plain


def test_an_earlier_method_warns_and_works():
    colors = np.ones((2, 3, 1, 3), np.float32)
    layers = Layers(
        colors=colors, defocus=np.zeros((2, 3, 1), np.float32), coverage=np.ones((2, 3, 1), np.float32)
    )
    with pytest.warns(DeprecationWarning, match="in_light is now with_mapped_colors"):
        assert layers.in_light(lambda light: 2 * light).colors.max() == 2


def test_an_earlier_class_warns_and_works():
    from bokehnet import effects

    with pytest.warns(DeprecationWarning, match="View is now Viewport"):
        assert effects.View is effects.Viewport
    with pytest.raises(AttributeError, match="no attribute 'Screen'"):
        effects.Screen  # noqa: B018


def test_earlier_keywords_warn_and_work(tmp_path):
    image = np.zeros((2, 3, 3), np.float32)
    with pytest.warns(DeprecationWarning, match="use extra_channels= instead of beside="):
        write_image(tmp_path / "a.exr", image, beside={"Z": np.ones((2, 3), np.float32)})
    with pytest.warns(DeprecationWarning, match=r"RenderOptions\(viewport=...\)"):
        Engine("scatter").render(
            image, np.zeros((2, 3), np.float32), place=Viewport(left=0, top=0, width=3, height=2)
        )
