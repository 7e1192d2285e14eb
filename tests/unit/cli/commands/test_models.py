"""Named depth networks, from a hub on this machine, each command in a process of its own.

``huggingface_hub`` reads its variables when it is imported, which is why.
"""

import contextlib
import json
import os
import socket
import subprocess
import sys

import numpy as np
import pytest
from numpy.testing import assert_allclose

from bokehnet.io.color.srgb import srgb_to_linear
from bokehnet.io.image import write_image
from bokehnet.io.maps import read_map
from tests.unit.inference.hub_server import REVISION, hub_server, write_table

pytest.importorskip("huggingface_hub", reason="needs the extra models")

HEIGHT, WIDTH = 48, 64

RUN = """
import sys
from pathlib import Path
from bokehnet.inference import depth_models
depth_models._TABLE, depth_models.PINS = Path("table.toml"), Path("pins.toml")
from bokehnet.cli.app import run
sys.exit(run(sys.argv[1:]))
"""


@pytest.fixture
def hub(tmp_path, write_red_network):
    """A hub with tests/tiny, a network that returns the red that it sees, as table.toml and pins.toml say."""
    write_red_network(tmp_path)
    content = (tmp_path / "tiny.onnx").read_bytes()
    (tmp_path / "tiny.onnx").unlink()
    srgb = np.broadcast_to(np.linspace(0.1, 0.9, WIDTH)[:, None], (HEIGHT, WIDTH, 3))
    write_image(tmp_path / "photo.png", srgb_to_linear(srgb))
    write_table(tmp_path, "tiny", "midas", content)
    with hub_server({("tests/tiny", "onnx/model.onnx"): content}) as server:
        yield server


@pytest.fixture
def run(hub, tmp_path):
    def call(*words, source=RUN, **variables):
        clean = {key: value for key, value in os.environ.items() if not key.startswith(("HF_", "BOKEHNET_"))}
        reports = {"HF_HOME": str(tmp_path / "cache"), "HF_ENDPOINT": hub.address, "HF_HUB_DISABLE_XET": "1"}
        return subprocess.run(
            [sys.executable, "-c", source, *words],
            cwd=tmp_path,
            env=clean | reports | {"PYTHONPATH": os.pathsep.join(sys.path)} | variables,
            capture_output=True,
            text=True,
            timeout=120,
            stdin=subprocess.DEVNULL,
        )

    return call


def stored(tmp_path):
    """Files of the cache but its own notes."""
    return [path for path in (tmp_path / "cache").rglob("blobs/*") if path.is_file()]


DEPTH = ("depth", "photo.png", "-o", "out.exr", "--model", "tiny")


@pytest.mark.slow
def test_a_network_is_downloaded_once_after_consent_and_used_offline_then(run, hub, tmp_path):
    refused = run(*DEPTH)
    assert (refused.returncode, refused.stderr.count("\n")) == (1, 1)
    for word in ("1 kB", hub.address, "licence mit", "bokehnet models tiny --get", "pictures never leave"):
        assert word in refused.stderr
    assert hub.asked == []
    assert stored(tmp_path) == []

    result = run("models", "tiny", "--get")
    assert (result.returncode, REVISION in result.stdout) == (0, True), result.stderr
    assert run("models").stdout.split()[1] == "downloaded"

    requested = len(hub.asked)
    done = run(*DEPTH, HF_HUB_OFFLINE="1")
    assert (done.returncode, done.stderr) == (0, "")
    assert len(hub.asked) == requested
    expected = np.broadcast_to(np.linspace(0, 1, WIDTH), (HEIGHT, WIDTH))
    assert_allclose(read_map(tmp_path / "out.exr"), expected, atol=0.03)


@pytest.mark.slow
def test_consent_can_be_given_ahead(run):
    assert run(*DEPTH, BOKEHNET_DOWNLOADS="yes").returncode == 0


@pytest.mark.slow
def test_a_photo_without_depth_is_rendered_once_a_network_is_there(run, tmp_path):
    render = ("render", "photo.png", "-o", "out.png", "--f-number", "1.8", "--json")
    without = run(*render)
    assert (without.returncode, "has no depth map" in without.stderr) == (1, True)
    assert "bokehnet models tiny --get downloads a network" in without.stderr
    forbidden = run(*render, BOKEHNET_DOWNLOADS="no").stderr
    assert "--depth-model estimates it" in forbidden
    assert "--get" not in forbidden
    run("models", "tiny", "--get")
    done = run(*render)
    assert done.returncode == 0, done.stderr
    assert "depth estimated by tiny" in done.stdout + done.stderr
    assert json.loads(done.stdout)["largest_blur_px"] > 0.1


@pytest.fixture
def on_terminal(hub, tmp_path):
    """Run a command with a terminal as stdin and stderr, and type an answer."""
    pty = pytest.importorskip("pty", reason="needs a POSIX terminal")

    def call(answer, *words, **variables):
        result, reference = pty.openpty()
        clean = {key: value for key, value in os.environ.items() if not key.startswith(("HF_", "BOKEHNET_"))}
        reports = {"HF_HOME": str(tmp_path / "cache"), "HF_ENDPOINT": hub.address, "HF_HUB_DISABLE_XET": "1"}
        process = subprocess.Popen(
            [sys.executable, "-c", RUN, *words],
            cwd=tmp_path,
            env=clean | reports | {"PYTHONPATH": os.pathsep.join(sys.path)} | variables,
            stdin=reference,
            stderr=reference,
            stdout=subprocess.DEVNULL,
        )
        os.close(reference)
        os.write(result, answer.encode())
        shown = b""
        with contextlib.suppress(OSError):  # the other end is closed
            while block := os.read(result, 4096):
                shown += block
        os.close(result)
        return process.wait(120), shown.decode()

    return call


@pytest.mark.slow
def test_a_photo_alone_is_rendered_after_one_question_on_a_terminal(on_terminal, hub, tmp_path):
    code, shown = on_terminal("n\n", "render", "photo.png")
    assert (code, "1 kB" in shown, "licence mit" in shown) == (1, True, True), shown
    assert f"{tmp_path / 'cache'}" in shown.replace("\r\n", "")
    assert "download declined" in shown
    assert "--depth-model FILE" in shown
    assert "--disparity MAP" in shown
    assert (hub.asked, stored(tmp_path), (tmp_path / "photo_bokeh.png").exists()) == ([], [], False)

    code, shown = on_terminal("y\n", "render", "photo.png", "--engine", "scatter")
    assert (code, shown.count("Download it?")) == (0, 1), shown
    assert "depth estimated by tiny" in shown
    assert "blur up to 4 % of the longer side" in shown
    assert (tmp_path / "photo_bokeh.png").exists()
    code, shown = on_terminal("", "render", "photo.png", "--engine", "scatter")
    assert (code, "Download it?" in shown) == (0, False)
    assert (tmp_path / "photo_bokeh_2.png").exists()


@pytest.mark.slow
@pytest.mark.parametrize(("name", "value"), [("HF_HUB_OFFLINE", "1"), ("BOKEHNET_DOWNLOADS", "no")])
def test_nothing_is_asked_on_a_terminal_if_the_environment_forbids_downloads(on_terminal, hub, name, value):
    code, shown = on_terminal("y\n", "render", "photo.png", **{name: value})
    shown = shown.removeprefix("y\r\n")  # echo of the terminal
    assert (code, shown.count("\n"), "Download it?" in shown) == (1, 1, False), shown
    for word in (name, "onnx/model.onnx", "--depth-model FILE", "--disparity MAP"):
        assert word in shown
    assert hub.asked == []


@pytest.mark.slow
def test_other_bytes_than_those_pinned_are_never_run(run, hub, tmp_path):
    hub.files["tests/tiny", "onnx/model.onnx"] += b" "
    done = run(*DEPTH, BOKEHNET_DOWNLOADS="yes")
    assert (done.returncode, done.stderr.count("\n")) == (1, 1)
    assert "tiny: expected SHA-256" in done.stderr
    assert stored(tmp_path) == []
    assert not (tmp_path / "out.exr").exists()


@pytest.mark.slow
def test_a_cached_file_that_was_changed_is_removed(run, tmp_path):
    run("models", "tiny", "--get")
    [blob] = stored(tmp_path)
    blob.write_bytes(b"something else")
    assert run("models").stdout.split()[1] == "damaged"
    assert run("models", "tiny", "--get").returncode == 0
    assert run(*DEPTH).returncode == 0


@pytest.mark.slow
def test_a_download_that_breaks_off_leaves_nothing_that_counts(run, hub, tmp_path):
    hub.cut = 99
    done = run("models", "tiny", "--get")
    assert (done.returncode, "cannot be downloaded" in done.stderr) == (1, True)
    assert done.stderr.count("\n") == 1
    assert run("models").stdout.split()[1:3] == ["to", "download"]
    hub.cut = 0
    assert run("models", "tiny", "--get").returncode == 0


@pytest.mark.slow
@pytest.mark.parametrize(
    ("variables", "change", "words"),
    [
        ({"HF_HUB_OFFLINE": "1"}, {}, ["HF_HUB_OFFLINE is set", "onnx/model.onnx", "unset it"]),
        ({"HF_ENDPOINT": "http://127.0.0.1:9"}, {}, ["127.0.0.1:9", "set HF_ENDPOINT for a mirror"]),
        ({}, {"gated": True}, ["an account", "HF_TOKEN"]),
        ({}, {"files": {}}, ["has no onnx/model.onnx of tests/tiny"]),
    ],
)
def test_obstacles_of_a_download_are_reported_in_one_line(run, hub, tmp_path, variables, change, words):
    for name, value in change.items():
        setattr(hub, name, value)
    done = run("models", "tiny", "--get", **variables)
    assert (done.returncode, done.stdout, done.stderr.count("\n")) == (1, "", 1)
    assert done.stderr.startswith("bokehnet: error: tiny: ")
    for word in words:
        assert word in done.stderr


@pytest.mark.slow
def test_an_entry_without_pins_is_refused_with_that_reason(run, hub, tmp_path):
    write_table(tmp_path, "tiny", "midas", None)
    for words in (
        DEPTH,
        ("models", "tiny", "--get"),
        ("render", "photo.png", "-o", "a.png", "--depth-model", "tiny", "--blur", "9", "--focus", "0.5"),
    ):
        done = run(*words, BOKEHNET_DOWNLOADS="yes")
        assert (done.returncode, done.stderr.count("\n")) == (1, 1)
        assert "revision and SHA-256 are not pinned" in done.stderr
    assert hub.asked == []


@pytest.mark.slow
def test_an_unknown_name_lists_the_known_ones(run):
    done = run("depth", "photo.png", "-o", "out.exr", "--model", "tinny")
    assert (done.returncode, "one of tiny" in done.stderr) == (1, True)


@pytest.mark.slow
def test_a_convention_with_a_named_network_is_refused(run):
    run("models", "tiny", "--get")
    done = run(*DEPTH, "--convention", "marigold")
    assert (done.returncode, "whose convention is midas" in done.stderr) == (1, True)


FETCH = """
import sys
from pathlib import Path
from bokehnet.errors import BokehnetError, RenderCancelled
from bokehnet.inference import depth_models
depth_models._TABLE, depth_models.PINS = Path("table.toml"), Path("pins.toml")
from bokehnet.inference.model_download import fetch_model
answer, stop = sys.argv[1] == "yes", "stop" in sys.argv
def agree(offer):
    print(offer.size, offer.bytes, offer.licence, offer.source, offer.folder)
    return answer
def progress(done, total):
    print("progress", done, total)
    if stop:
        raise RenderCancelled
try:
    print(fetch_model(depth_models.recommended_model(), agree, progress).name)
except (BokehnetError, RenderCancelled) as error:
    print(type(error).__name__, error)
"""


@pytest.mark.slow
def test_a_program_shows_the_offer_and_downloads_after_consent_only(run, hub, tmp_path):
    size = len(hub.files["tests/tiny", "onnx/model.onnx"])
    declined = run("no", source=FETCH)
    offer, outcome = declined.stdout.splitlines()
    assert offer.split()[:5] == ["1", "kB", str(size), "mit", f"{hub.address}/tests/tiny"]
    assert str(tmp_path / "cache") in offer
    assert outcome.startswith("ModelFileError tiny: download declined")
    assert hub.asked == []
    assert stored(tmp_path) == []

    agreed = run("yes", source=FETCH).stdout.splitlines()
    assert f"progress {size} {size}" in agreed
    assert agreed[-1] == "model.onnx"
    requested = len(hub.asked)
    assert run("no", source=FETCH).stdout.splitlines() == ["model.onnx"]  # no question for what is here
    assert len(hub.asked) == requested


@pytest.mark.slow
def test_a_download_can_be_cancelled(run, tmp_path):
    cancelled = run("yes", "stop", source=FETCH)
    assert cancelled.stdout.splitlines()[-1].startswith("RenderCancelled"), cancelled.stderr
    assert run("models").stdout.split()[1:3] == ["to", "download"]


@pytest.mark.slow
def test_a_network_pinned_by_hash_alone_follows_the_newest_commit(run, hub, tmp_path):
    pins = (tmp_path / "pins.toml").read_text()
    (tmp_path / "pins.toml").write_text(pins.replace(REVISION, "main"))
    assert run("models", "tiny", "--get").returncode == 0
    assert run(*DEPTH, HF_HUB_OFFLINE="1").returncode == 0
    assert run("--check", source=PIN).returncode == 0
    hub.files["tests/tiny", "onnx/model.onnx"] += b" "
    changed = run(*DEPTH, BOKEHNET_DOWNLOADS="yes", HF_HOME=str(tmp_path / "other"))
    assert "expected SHA-256" in changed.stderr


PIN = """
import sys
from pathlib import Path
from bokehnet.inference import depth_models
depth_models._TABLE, depth_models.PINS = Path("table.toml"), Path("pins.toml")
from tools.pin_models import main
sys.exit(main(sys.argv[1:]))
"""


@pytest.mark.slow
def test_the_release_command_pins_what_the_hub_has(run, hub, tmp_path):
    pins = (tmp_path / "pins.toml").read_text()
    write_table(tmp_path, "tiny", "midas", None)
    assert run("--check", source=PIN).returncode == 1
    assert run(source=PIN).returncode == 0
    assert pins in (tmp_path / "pins.toml").read_text()
    assert 'attested = "the hub, and the downloaded file' in (tmp_path / "pins.toml").read_text()
    assert run("--check", source=PIN).returncode == 0
    assert run("models", "tiny", "--get").returncode == 0
    hub.licence = "cc-by-nc-4.0"
    done = run(source=PIN)
    assert (done.returncode, "expected the licence mit, found cc-by-nc-4.0" in done.stderr) == (1, True)
    assert pins in (tmp_path / "pins.toml").read_text()


def test_an_unreachable_hub_is_reported_without_waiting(run):
    """``huggingface_hub`` sleeps between its attempts, which ends this process."""
    with socket.socket() as closed:  # bound, but nobody listens
        closed.bind(("127.0.0.1", 0))
        address = f"http://127.0.0.1:{closed.getsockname()[1]}"
        source = f"import sys, time\ntime.sleep = lambda seconds: sys.exit('waited')\n{RUN}"
        done = run("models", "tiny", "--get", source=source, HF_ENDPOINT=address)
    assert (done.returncode, done.stderr.count("\n")) == (1, 1)
    assert done.stderr.startswith(f"bokehnet: error: tiny: cannot be downloaded from {address}: ")
    for way_out in (
        "HF_ENDPOINT",
        "copy ",
        "onnx/model.onnx of tests/tiny as a file with the convention midas",
    ):
        assert way_out in done.stderr
