"""Every command that may take longer than two seconds shows how far it is, and ends cleanly by Ctrl-C.

``bokehnet render`` and ``trace`` have tests of a true signal beside those of their own; training too.
"""

from functools import partial
from pathlib import Path

import pytest

from bokehnet.tools import psf_sheet

ROOT = Path(__file__).resolve().parents[3]

COMMANDS = {
    "demo": (["demo", "--engine", "scatter", "-o", "out.png"], "rendering"),
    "render": (["render", "photo.png", "--blur", 3, "--focus", 0.4, "-o", "out.png"], "rendering"),
    "depth": (["depth", "photo.png", "-o", "out.png", "--model", "tiny.onnx"], "estimating depth"),
    "lens": (["lens", "biconvex", "--psf-sheet", "out.png"], "tracing"),
    "export": (["export", "-o", "out.onnx"], "verifying"),
    "trace": (
        ["trace", ROOT / "configs/scene_balls.toml", "-o", "out.exr", "--width", 24, "--samples", 2],
        "tracing samples",
    ),
}
COMMANDS["render"][0].extend(["--disparity", "disparity.png", "--engine", "scatter"])
COMMANDS["depth"][0].extend(["--convention", "tiny.toml"])
COMMANDS["trace"][0].extend(["--height", 16])


EXTRAS = {"export": "onnx", "trace": "torch"}


@pytest.fixture
def words(folder, request):
    if request.param in EXTRAS:
        pytest.importorskip(EXTRAS[request.param], reason="needs the extra train")
    if request.param == "lens":
        few = partial(psf_sheet.psf_pairs, rays=500)
        request.getfixturevalue("monkeypatch").setattr(psf_sheet, "psf_pairs", few)
    if request.param == "depth":
        request.getfixturevalue("write_red_network")(folder)
    return COMMANDS[request.param]


SLOW = ("lens", "export", "trace")
every = pytest.mark.parametrize(
    "words",
    [pytest.param(name, marks=pytest.mark.slow if name in SLOW else ()) for name in COMMANDS],
    indirect=True,
)


@every
def test_progress_appears_on_stderr(words, cli, on_terminal):
    """From the first moment on, also before anything is done."""
    arguments, label = words
    outcome = cli(*arguments)
    assert outcome.code == 0
    first = "reading" if arguments[0] == "render" else label
    assert outcome.err.startswith(f"\r{first}: ")
    assert f"{label}: 100%" in outcome.err


@every
def test_ctrl_c_is_one_line_and_leaves_no_half_of_a_file(words, folder, cli, monkeypatch):
    """KeyboardInterrupt is what Python makes of the signal; here it comes with the first report."""
    import tqdm

    def interrupt(*_, **__):
        raise KeyboardInterrupt

    before = set(folder.iterdir())
    monkeypatch.setattr(tqdm.tqdm, "update", interrupt)
    arguments, _ = words
    outcome = cli(*arguments)
    assert (outcome.code, outcome.out) == (130, "")
    assert outcome.err.splitlines()[-1] == "bokehnet: interrupted"
    assert set(folder.iterdir()) == before
