import numba
from tqdm import tqdm

from bokehnet.cli.progress import compile_notice, progress, stages, write_above
from bokehnet.precompiled.library import OFF


def make_kernel():
    @numba.njit
    def double(x):
        return 2 * x

    return double


def test_compilation_is_announced_once(capsys):
    first, second = make_kernel(), make_kernel()
    with compile_notice():
        assert first(1) == 2
        assert second(1) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err == "bokehnet: compiling kernels for this machine, once; this may take a minute\n"


def test_a_bar_shows_compilation(on_terminal, monkeypatch):
    kernel, shown = make_kernel(), []
    with compile_notice(), stages() as begin:
        begin("rendering")(1, 4)
        (bar,) = list(tqdm._instances)
        monkeypatch.setattr(bar, "set_postfix_str", lambda text, refresh: shown.append(text))
        kernel(1)
    assert shown[0] == "compiling, functions so far: 1"
    assert shown[-1] == ""


def test_kernels_that_are_there_are_run_in_silence(capsys):
    kernel = make_kernel()
    kernel(1)
    with compile_notice():
        kernel(1)
    make_kernel()(1)
    assert capsys.readouterr() == ("", "")


def test_only_the_first_render_announces_compilation(folder, cli_process, monkeypatch):
    """In processes of their own, with an empty cache of numba's."""
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(folder / "cache"))
    monkeypatch.setenv(OFF, "1")
    photo, disparity, output = (folder / name for name in ("photo.png", "disparity.png", "out.png"))
    words = ("render", photo, "--disparity", disparity, "--blur", 2, "--focus", 0, "-o", output)
    words += ("--engine", "scatter", "--repair-disparity", "off")
    first = cli_process(*words)
    assert first.code == 0
    assert first.err.count("bokehnet: compiling kernels for this machine, once") == 1
    second = cli_process(*words)
    assert second.code == 0
    assert second.err.splitlines()[-1].startswith(f"bokehnet: {output}: ")
    assert "compiling" not in second.err


def test_progress_is_silent_when_the_work_is_short(capsys, on_terminal, monkeypatch):
    monkeypatch.setattr("bokehnet.cli.progress._DELAY", 1.0)
    with progress("rendering") as report:
        report(0, 3)
        report(3, 3)
    assert capsys.readouterr() == ("", "")


def test_a_log_file_gets_lines_on_request(capsys, monkeypatch):
    """Two of 10 steps were done before; two more took 60 s, so that the other six take 180 s."""
    times = iter([0.0, 10.0, 60.0, 61.0])
    monkeypatch.setattr("bokehnet.cli.progress.time.monotonic", lambda: next(times))
    with progress("rendering scenes", lines=True) as report:
        for done in (2, 3, 4, 5):
            report(done, 10)
    shown = capsys.readouterr().err.splitlines()
    assert shown == [
        "bokehnet: rendering scenes: 2 of 10",
        "bokehnet: rendering scenes: 4 of 10, 03:00 left",
    ]
    with progress("rendering scenes") as report:
        report(2, 10)
    assert capsys.readouterr() == ("", "")


def test_stages_that_are_short_are_silent(capsys, on_terminal, monkeypatch):
    monkeypatch.setattr("bokehnet.cli.progress._DELAY", 1.0)
    with stages() as begin:
        begin("reading")
        begin("writing")(1, 1)
    assert capsys.readouterr() == ("", "")


def test_stages_that_take_long_are_shown(capsys, on_terminal):
    with stages() as begin:
        begin("rendering")(1, 4)
        begin("writing")(1, 2)
    shown = capsys.readouterr().err
    assert shown.index("rendering:  25%") < shown.index("writing:  50%")
    assert "left" in shown


def test_progress_shows_label_and_count_on_stderr_when_the_work_is_long(capsys, on_terminal):
    with progress("rendering") as report:
        report(1, 4)
        report(4, 4)
    captured = capsys.readouterr()
    assert captured.out == ""
    assert "rendering" in captured.err
    assert "4/4" in captured.err


def test_a_log_gets_lines_but_no_bar(capsys, monkeypatch):
    """Stderr is no terminal here."""
    monkeypatch.setattr("bokehnet.cli.progress._DELAY", 0.0)
    with stages() as begin:
        begin("reading")(1, 4)
        write_above("bokehnet: note: a warning")
        begin("rendering")(1, 4)
    with progress("tracing samples") as report:
        report(4, 4)
    assert capsys.readouterr() == ("", "bokehnet: note: a warning\n")
