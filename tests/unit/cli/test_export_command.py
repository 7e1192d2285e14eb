"""``bokehnet export``."""

import re
import sys

import pytest

pytest.importorskip("onnx", reason="needs onnx")

from tests.unit.onnx_file.running import picture, start, steps


@pytest.mark.parametrize(
    ("flags", "engine"),
    [([], "fast"), (["--full"], "fast"), (["--engine", "neural"], "neural")],
    ids=["plain", "as older scripts say it", "neural"],
)
def test_one_file_is_written_that_renders(cli, no_bar, tmp_path, random_weights, flags, engine):
    import numpy as np
    import onnx

    path = tmp_path / "out file.onnx"
    outcome = cli("export", *flags, "-o", path, "--weights", random_weights)
    assert (outcome.code, outcome.err) == (0, "")
    assert re.fullmatch(
        rf"wrote {re.escape(str(path))}: \d+\.\d MB, PSNR of at least \d+ dB against engine {engine}\n",
        outcome.out,
    )
    scalars = {name: np.array(1, np.float32) for name in ("K", "focus", "gamma")}
    inputs = {"image": picture(20, 30), "disparity": steps(20, 30, 1), **scalars}
    assert start(onnx.load(path)).run(None, inputs)[0].shape == (20, 30, 3)


def test_the_repair_is_a_file_of_its_own(cli, no_bar, tmp_path):
    import numpy as np
    import onnx

    path = tmp_path / "repair.onnx"
    outcome = cli("export", "--repair", "-o", path)
    assert (outcome.code, outcome.err) == (0, "")
    assert re.fullmatch(
        rf"wrote {re.escape(str(path))}: 0\.\d+ MB, \d+\.\d% of a soft map repaired as by the package\n",
        outcome.out,
    )
    disparity = np.abs(steps(20, 30, 1))
    repaired = start(onnx.load(path)).run(None, {"image": picture(20, 30), "disparity": disparity})[0]
    np.testing.assert_array_equal(repaired, disparity)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["-o", "nowhere/out.onnx"], ["nowhere", "does not exist"]),
        (["-o", "out.txt"], ["out.txt: unknown extension '.txt', expected .onnx"]),
        (["-o", "out.onnx", "--weights", "nowhere"], ["nowhere/manifest.json"]),
        (
            ["-o", "out.onnx", "--engine", "hybrid"],
            ["expected one of bokehme, fast, neural, rays, got 'hybrid'"],
        ),
        (["-o", "out.onnx", "--repair", "--engine", "fast"], ["--engine: expected none with --repair"]),
        (["-o", "out.onnx", "--repair", "--weights", "."], ["--weights: expected none with --repair"]),
        ([], ["--output"]),
    ],
)
def test_mistakes_are_one_line(cli, tmp_path, monkeypatch, arguments, words):
    monkeypatch.chdir(tmp_path)
    outcome = cli("export", *arguments)
    assert (outcome.code, outcome.out) == (1, "")
    assert outcome.err.startswith("bokehnet: error: ")
    assert outcome.err.count("\n") == 1
    for word in words:
        assert word in outcome.err
    assert not list(tmp_path.iterdir())


def test_without_onnx_its_installation_is_named(cli, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "onnx", None)
    outcome = cli("export", "-o", tmp_path / "out.onnx")
    assert outcome.code == 1
    assert "needs onnx: pip install onnx\n" in outcome.err


def test_the_command_needs_no_torch(python_process, tmp_path):
    source = "import sys; sys.modules['torch'] = None; from bokehnet.cli.app import main; main()"
    outcome = python_process(source, "export", "-o", tmp_path / "out.onnx")
    assert outcome.code == 0, outcome.err
    assert (tmp_path / "out.onnx").stat().st_size > 4e6
