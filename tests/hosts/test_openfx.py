"""The OpenFX plug-in in the host example of the OpenFX repository. Authority: bokehnet's renderer by itself.

``OPENFX_ROOT`` names a checkout of that repository, ``OPENFX_HOST`` its host example as built from there.
That host renders one plug-in, by the name of the repository's first example: ours is built with that name.
All its numbers are 2, all its choices unknown, and both inputs are one picture of digits.
"""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from bokehnet import BokehRenderer, DefocusMap, RenderSettings, make_scene

ROOT = Path(__file__).parents[2]
OPENFX = Path(os.environ.get("OPENFX_ROOT", ROOT.parent / "openfx"))
HOST = os.environ.get("OPENFX_HOST", "")
FIRST_EXAMPLE = "net.sf.openfx:invertPlugin"

pytestmark = [
    pytest.mark.host,
    pytest.mark.skipif(not (OPENFX / "include").is_dir(), reason="needs a checkout of OpenFX: OPENFX_ROOT"),
    pytest.mark.skipif(not shutil.which("cmake"), reason="needs cmake and a C++ compiler"),
]


@pytest.fixture(scope="module")
def plugin(tmp_path_factory):
    folder = tmp_path_factory.mktemp("openfx")
    reports = [f"-DOPENFX_ROOT={OPENFX}", f"-DBOKEHNET_OFX_ID={FIRST_EXAMPLE}"]
    for words in (
        ["-S", str(ROOT / "integrations/openfx"), "-B", str(folder), *reports],
        ["--build", str(folder)],
    ):
        done = subprocess.run(["cmake", *words], capture_output=True, text=True)
        assert done.returncode == 0, done.stdout + done.stderr
        assert "warning" not in (done.stdout + done.stderr).lower()
    assert list(folder.glob("bokehnet.ofx.bundle/Contents/*/bokehnet.ofx"))
    return folder


def run_host(plugin, folder, python=sys.executable):
    if not HOST:
        pytest.skip("needs the host example of OpenFX, built: OPENFX_HOST")
    environment = dict(os.environ, OFX_PLUGIN_PATH=str(plugin), BOKEHNET_PYTHON=python, PYTHONPATH=str(ROOT))
    words = ["stdbuf", "-o0", HOST]  # it may end by an assertion of its own
    return subprocess.run(words, cwd=folder, env=environment, capture_output=True, text=True, timeout=300)


def digits(width, height, rows):
    """Frame 0 of the host's picture, white on black: 00.0, below it 0; rows as the host counts them."""
    zero, point = (".#.", "#.#", "#.#", "#.#", ".#."), ("...", "...", "...", "...", ".#.")
    picture = np.zeros((height, width), np.float32)
    for top, line in zip((50, 90), rows, strict=True):
        for place, shape in enumerate({"0": zero, ".": point}[letter] for letter in line):
            cells = np.array([[cell == "#" for cell in row] for row in shape], np.float32)
            picture[top : top + 25, 50 + 20 * place : 65 + 20 * place] = np.kron(cells, np.ones((5, 5)))
    return picture


@pytest.mark.slow
def test_the_host_example_renders_what_the_renderer_does(plugin, tmp_path):
    done = run_host(plugin, tmp_path)
    assert done.returncode == 0, done.stdout + done.stderr
    assert f"Plug-in:{FIRST_EXAMPLE}" in done.stdout
    assert "OfxImageEffectContextGeneral" in done.stdout
    words = (tmp_path / "Output.0.ppm").read_text().splitlines()[4:]
    result = np.array([line.split() for line in words], np.float32).reshape(576, 720, 3)

    picture = digits(720, 576, ("00.0", "0"))[::-1]  # upright
    scene = make_scene(
        np.repeat(picture[..., None], 3, -1), DefocusMap(map=np.full((576, 720), 2, np.float32))
    )
    shape = {"cats_eye": 1.5, "squeeze": 2 / (768 / 720)}  # 2, but for pixels that are wider than high
    expected = BokehRenderer().render(scene, RenderSettings().updated({"aperture": shape})).bokeh[::-1]
    assert 0 < result[60, 49].max() < 255  # beside a stroke
    assert np.abs(result - 255 * np.clip(expected, 0, 1)).max() <= 1
    assert not list(Path("/dev/shm").glob("bokehnet-*"))


def test_what_is_wrong_is_a_message_of_the_host(plugin, tmp_path):
    done = run_host(plugin, tmp_path, python="/bin/false")
    assert "OfxMessageError" in done.stdout
    assert "BOKEHNET_PYTHON: expected a Python with bokehnet, found /bin/false" in done.stdout
