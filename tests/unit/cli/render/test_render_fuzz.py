"""Whatever is typed: a picture and silence, or one line that says what is wrong. Never anything else."""

import os

import pytest
from hypothesis import HealthCheck, event, given, settings
from hypothesis import strategies as st

# More examples by the environment, such as BOKEHNET_FUZZ_EXAMPLES=20000.
EXAMPLES = int(os.environ.get("BOKEHNET_FUZZ_EXAMPLES", "150"))

ODD_NUMBERS = ["0", "-0", "1", "-1", "1e9", "1e-9", "1e308", "1e-320", "inf", "-inf", "nan"]
NUMBERS = st.one_of(
    st.floats(0.05, 1).map(lambda value: f"{value:.3g}"),
    st.floats(1, 60).map(lambda value: f"{value:.3g}"),
    st.sampled_from(ODD_NUMBERS),
    st.text("0123456789.,-e#%x ", max_size=6),
)
PAIRS = st.one_of(st.tuples(NUMBERS, NUMBERS).map(",".join), NUMBERS)
FILES = st.sampled_from(
    [
        "photo.png",
        "disparity.png",
        "camera.exr",
        "pull.csv",
        "missing.exr",
        ".",
        "a.####.exr",
        "-x.png",
        "",
        "ü b.png",
    ]
)
FLAGS = ("--invert", "--no-invert", "--resize-disparity", "--overwrite")
VALUES = {
    **dict.fromkeys(("--disparity", "--depth", "--pull", "--aperture-image"), FILES),
    **dict.fromkeys(("--defocus-map", "--depth-model", "--settings", "--preset"), FILES),
    **dict.fromkeys(("--focus-at", "--focus-range", "--disparity-range"), PAIRS),
    **dict.fromkeys(
        (
            "--blur", "--focus", "--focal-length", "--f-number", "--focus-distance", "--sensor-width",
            "--focus-from", "--focus-to", "--f-number-from", "--f-number-to", "--blur-from", "--blur-to",
            "--gamma", "--highlights", "--highlight-gain", "--squeeze", "--rim",
            "--constant-disparity", "--cats-eye", "--obstruction", "--blade-curvature", "--aperture-rotation",
        ),
        NUMBERS,
    ),
    "--blades": st.sampled_from(["0", "3", "6", "-1", "99", "x"]),
    "--depth-unit": st.sampled_from(["m", "1/m", "ft", "parsec"]),
    "--pixel-filter": st.sampled_from(["auto", "cycles", "box:0", "gaussian:1.4", "mitchell:x", ""]),
    "--mixed-depth": st.sampled_from(["on", "off", "auto", ""]),
    "--max-memory": st.sampled_from(["0", "1", "600M", "4G", "1e9", "4X", ""]),
    "--channel": st.sampled_from(["Z", "R", "far", "", "Q"]),
    "--frames": st.sampled_from(["1", "1-3", "3-1", "1-3x2", "", "-", "1,2", "9999999999"]),
}  # fmt: skip
STARTS = st.sampled_from(
    [
        ["--disparity", "disparity.png", "--blur", "3", "--focus", "0.4", "-o", "out.png"],
        ["--disparity", "disparity.png", "--blur", "3", "-o", "out.exr"],
        ["--depth", "camera.exr", "--focal-length", "50", "--sensor-width", "36", "-o", "out.jpg"],
        ["--frames", "1-2", "--disparity", "disparity.png", "--blur", "3", "-o", "out.#.exr"],
        ["--frames", "1-2", "--depth", "camera.exr", "--focal-length", "50", "--sensor-width", "36"],
    ]
)
ENOUGH = st.sampled_from([["--focus", "0.2"], ["--f-number", "4", "--focus-distance", "2"], []])


@st.composite
def command_lines(draw):
    words = ["render", draw(st.sampled_from(["photo.png", "camera.exr"])), *draw(STARTS), *draw(ENOUGH)]
    for option in draw(st.lists(st.sampled_from(sorted([*VALUES, *FLAGS])), max_size=3, unique=True)):
        words.append(option)
        if option in VALUES:
            words.append(draw(VALUES[option]))
    if "-o" not in words or draw(st.integers(0, 9)) == 0:
        words += ["-o", draw(st.sampled_from(["out.png", "out.#.png", "no/out.png", "out.xyz"]))]
    return [*words, "--engine", "scatter", "--repair-disparity", "off"]


@pytest.mark.slow
@settings(
    max_examples=EXAMPLES,
    deadline=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
    database=None,
)
@given(words=command_lines())
def test_a_picture_or_one_line(folder, cli, words):
    """Any other exception than the program's own passes through ``run`` and fails here."""
    (folder / "pull.csv").write_text("frame,focus\n1,0.2\n3,0.9\n")
    outcome = cli(*words)
    event(f"exit code {outcome.code}")
    assert outcome.code in (0, 1)
    assert "Traceback" not in outcome.err
    if outcome.code == 1:
        assert outcome.err.rstrip("\n").splitlines()[-1].startswith("bokehnet: error: ")
    else:
        *notes, summary = outcome.err.splitlines()
        assert summary.startswith("bokehnet: ")
        assert "error" not in summary
        assert all(line.startswith("bokehnet: note: ") for line in notes)
        assert list(folder.glob("out.*"))
    assert not list(folder.glob(".bokehnet-*"))
