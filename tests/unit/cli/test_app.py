import subprocess
import sys

import click
import numpy as np
import pytest

import bokehnet
from bokehnet.cli import app as application
from bokehnet.errors import BokehnetError
from bokehnet.io.image import write_image, write_map


def one_line(text):
    return text.count("\n") == 1 and text.endswith("\n")


@pytest.mark.parametrize(
    ("arguments", "reason"),
    [
        (["info", "missing.png"], "missing.png: no such file"),
        (["info"], "Missing argument"),
        (["info", "--bogus", "a.png"], "--bogus: no such option; see bokehnet info --help"),
        (["render", "a.png", "--blurr", "3"], "--blurr: no such option; did you mean --blur?"),
        (["render", "a.png", "--aperture", "2.8"], "did you mean --f-number?"),
        (["bogus"], "bogus"),
        (["rendr"], "Did you mean 'render'?"),
        ([__file__], f"To render this file: bokehnet render {__file__}"),
        (["info", "a.png", "b.png"], "b.png"),
    ],
)
def test_a_mistake_of_the_user_is_one_line_on_stderr_and_exit_code_1(cli, arguments, reason):
    outcome = cli(*arguments)
    assert (outcome.code, outcome.out) == (1, "")
    assert outcome.err.startswith("bokehnet: error: ")
    assert reason in outcome.err
    assert one_line(outcome.err)


def test_a_truncated_png_is_one_line_in_a_process_of_its_own(tmp_path, cli_process):
    path = tmp_path / "a.png"
    write_image(path, np.random.default_rng(0).random((64, 64, 3)))
    path.write_bytes(path.read_bytes()[:-500])
    outcome = cli_process("info", path)
    assert (outcome.code, outcome.out) == (1, "")
    assert "truncated" in outcome.err
    assert one_line(outcome.err)


def test_version_and_help(cli_process, cli):
    assert cli_process("--version").out == f"bokehnet {bokehnet.__version__}\n"
    for arguments in ([], ["--help"]):
        outcome = cli(*arguments)
        assert outcome.code == 0
        assert "info" in outcome.out
        assert "synth" in outcome.out


def test_summaries_of_commands_are_not_cut(cli, monkeypatch):
    """click cuts a summary that exceeds the line of 80 columns, and ends it by three dots."""
    monkeypatch.setenv("COLUMNS", "80")
    commands = application.app.commands.items()
    groups = [[], *([name] for name, command in commands if isinstance(command, click.Group))]
    assert ["lens"] in groups
    for group in groups:
        _, _, summaries = cli(*group, "--help").out.partition("Commands:")
        assert summaries
        assert [line for line in summaries.splitlines() if line.endswith("...")] == []


def test_help_imports_nothing_heavy(python_process):
    source = (
        "import sys; from bokehnet.cli.app import run\n"
        "assert run(['--help']) == run(['info', '--help']) == 0\n"
        "heavy = {'numpy', 'numba', 'torch', 'OpenImageIO', 'onnxruntime', 'tqdm'} & set(sys.modules)\n"
        "sys.exit(', '.join(heavy) or 0)"
    )
    outcome = python_process(source)
    assert (outcome.code, outcome.err) == (0, "")


def raiser(error):
    def command() -> None:
        raise error

    return command


@pytest.fixture
def failing(monkeypatch):
    """Add a command that raises to the application, for one test."""

    def add(error):
        monkeypatch.setitem(application.app.commands, "fail", click.Command("fail", callback=raiser(error)))

    return add


@pytest.mark.parametrize(
    ("error", "code", "text"),
    [
        (BokehnetError("first\nsecond"), 1, "bokehnet: error: first second\n"),
        (MemoryError("Unable to allocate 9 TiB"), 1, "9 TiB"),
        (KeyboardInterrupt(), 130, "bokehnet: interrupted\n"),
    ],
)
def test_known_ends_are_one_line(failing, cli, error, code, text):
    failing(error)
    outcome = cli("fail")
    assert (outcome.code, outcome.out) == (code, "")
    assert text in outcome.err
    assert one_line(outcome.err)


def test_a_bug_keeps_its_traceback(failing):
    failing(ZeroDivisionError("bug"))
    with pytest.raises(ZeroDivisionError, match="bug"):
        application.run(["fail"])


@pytest.mark.slow
def test_the_traceback_of_a_bug_is_the_plain_one():
    source = (
        "from bokehnet.cli import app\n"
        "def fail() -> None:\n    raise ZeroDivisionError('bug')\n"
        "app.app.command()(fail)\n"
        "import sys; sys.argv = ['bokehnet', 'fail']; app.main()"
    )
    done = subprocess.run([sys.executable, "-c", source], capture_output=True, text=True, check=False)
    assert done.returncode == 1
    assert done.stderr.startswith("Traceback (most recent call last):")
    assert done.stderr.endswith("ZeroDivisionError: bug\n")


@pytest.mark.slow
def test_numbers_out_of_float_range_are_reported_in_one_line(tmp_path):
    """NumPy warns of the overflow besides; the program does not pass that on."""
    write_image(tmp_path / "photo.png", np.full((8, 8, 3), 0.5, np.float32))
    write_map(tmp_path / "z.exr", np.tile(np.linspace(1, 5, 8, dtype=np.float32), (8, 1)))
    files = [
        tmp_path / "photo.png",
        "--depth",
        tmp_path / "z.exr",
        "--channel",
        "Y",
        "-o",
        tmp_path / "out.png",
    ]
    words = ["--focal-length", "50", "--f-number", "1e-38", "--focus-distance", "2", "--sensor-width", "36"]
    done = subprocess.run(
        [sys.executable, "-m", "bokehnet", "render", *files, *words],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 1
    lines = done.stderr.splitlines()
    reports = [line for line in lines if line.startswith("bokehnet: ") and "compiling" not in line]  # no bars
    assert [line[:16] for line in reports] == ["bokehnet: error:"]
    assert "expected finite values" in done.stderr


@pytest.mark.slow
def test_the_program_leaves_at_once_but_leaves_nothing_undone(tmp_path):
    source = (
        "import atexit, sys, threading, time\n"
        "from bokehnet.cli import app\n"
        "def last() -> None:\n    print('said at the end')\n    sys.stdout.flush()\n"
        "@app.app.command()\n"
        "def work() -> None:\n    print('said'); atexit.register(last)\n"
        "    if {late}: threading.Thread(target=lambda: (time.sleep(0.3), print('said late'))).start()\n"
        "sys.argv = ['bokehnet', *{words}]; app.main(); print('never said')"
    )

    def ran(words: list[str], late: bool = False) -> tuple[int, str]:
        code = source.format(words=words, late=late)
        done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
        return done.returncode, done.stdout

    assert ran(["work"]) == (0, "said\nsaid at the end\n")
    assert ran(["work"], late=True) == (0, "said\nsaid late\nsaid at the end\n")
    assert ran(["render"])[0] == 1
