"""What all baselines have in common, and that engines render with them."""

import numpy as np
import pytest

from bokehnet import Aperture, BokehRenderer, baselines, read_image, write_image
from bokehnet.baselines import BASELINES
from bokehnet.errors import ParameterError, ShapeError
from bokehnet.inference.engine import ENGINES, Engine
from bokehnet.io.image import write_map
from bokehnet.optics.chromatic_aberration import ChromaticAberration
from bokehnet.optics.lens_response import LensResponse

NAMES = [*BASELINES]


def scene(height=33, width=41):
    rng = np.random.default_rng(5)
    image = rng.random((height, width, 3)).astype(np.float32)
    defocus = np.full((height, width), -3.0, np.float32)
    defocus[8:20, 10:24] = 4.5
    defocus[22:, :] = 0
    return image, defocus


@pytest.mark.parametrize("name", NAMES)
def test_one_colour_stays_one_colour(name):
    _, defocus = scene()
    image = np.full((*defocus.shape, 3), (0.2, 0.5, 3.0), np.float32)
    assert np.allclose(getattr(baselines, name)(image, defocus), image, rtol=2e-3)


@pytest.mark.parametrize("name", NAMES)
def test_what_is_in_focus_stays_as_it_is(name):
    image, defocus = scene()
    bokeh = getattr(baselines, name)(image, np.zeros_like(defocus))
    spot = (
        0.35 if name in ("lommel", "bokehme_scatter") else 1e-6
    )  # diffraction, and discs of more than a pixel
    assert np.abs(bokeh - image).max() <= spot
    assert bokeh.dtype == np.float32
    assert bokeh is not image


@pytest.mark.parametrize("name", NAMES)
def test_the_engine_renders_what_the_function_renders(name):
    image, defocus = scene()
    rendered = Engine(name).render(image, defocus)
    assert np.array_equal(rendered.bokeh, getattr(baselines, name)(image, defocus))
    assert rendered.error_map.shape == defocus.shape


@pytest.mark.parametrize("name", NAMES)
def test_what_a_method_does_not_know_is_refused(name):
    image, defocus = scene(12, 12)
    method, fringes = (
        getattr(baselines, name),
        LensResponse(chromatic_aberration=ChromaticAberration(axial=1)),
    )
    if name != "lens_spreading":
        with pytest.raises(ParameterError, match=r"^engine: expected one that knows aberrations"):
            Engine(name).render(image, defocus, lens_response=fringes)
    with pytest.raises(ParameterError, match=r"^max_memory: expected None"):
        Engine(name).render(image, defocus, max_memory=10**9)
    with pytest.raises(ShapeError):
        method(image, defocus[1:])
    with pytest.raises(ParameterError, match="defocus"):
        method(image, np.where(defocus > 0, np.nan, defocus))
    known = BASELINES[name].openings
    for aperture, knows in (
        (Aperture(blades=5), ("outline", "cats-eye", "any")),
        (Aperture(obstruction=0.4), ("any",)),
        (Aperture(cats_eye=0.8), ("cats-eye",)),
    ):
        if known in knows:
            assert np.isfinite(method(image, defocus, aperture)).all()
        else:
            with pytest.raises(ParameterError, match=rf"^aperture: expected .*{name}"):
                method(image, defocus, aperture)


def test_baselines_stand_beside_the_engines():
    assert not set(BASELINES) & set(ENGINES)
    assert set(BASELINES) < set(baselines.__all__)
    for name in BASELINES:
        assert getattr(baselines, name).__doc__.count("Source:") == 1
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        _ = baselines.nothing


def test_the_command_line_renders_with_a_baseline(cli, tmp_path):
    image, defocus = scene()
    write_image(tmp_path / "in.exr", image)
    write_map(tmp_path / "d.exr", (defocus + 3) / 7.5, channel="disparity")
    words = ["render", tmp_path / "in.exr", "--disparity", tmp_path / "d.exr", "--blur", 7.5, "--focus", 0.4]
    words += ["--disparity-range", "0,1", "--repair-disparity", "off", "--engine", "overlap"]
    done = cli(*words, "-o", tmp_path / "out.exr")
    assert done.code == 0, done.err
    found = read_image(tmp_path / "out.exr")
    wanted = BokehRenderer("overlap").render(read_image(tmp_path / "in.exr"), defocus).bokeh
    assert np.abs(found - wanted).max() < 0.02
    refused = cli(*words, "-o", tmp_path / "no.exr", "--blades", 5)
    assert refused.code == 1
    assert "overlap" in refused.err
    assert not (tmp_path / "no.exr").exists()
    bounded = cli(*words, "-o", tmp_path / "no.exr", "--max-memory", "2G")
    assert bounded.code == 1
    assert "--max-memory" in bounded.err
    assert not (tmp_path / "no.exr").exists()
