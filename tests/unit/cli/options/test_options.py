"""The command line as it is made from the settings: help, names, completion, sources, files of settings."""

import os
import re
import subprocess
import sys

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from bokehnet.io.image import read_image, write_map
from bokehnet.io.maps import read_disparity, read_map
from bokehnet.sequence.sequence import SequenceSettings
from bokehnet.settings.fields import field_settings
from bokehnet.settings.settings import all_settings, group_types
from bokehnet.settings.settings_file import load_settings

FAST = ("--engine", "scatter", "--repair-disparity", "off")
SHORT = ("render", "photo.png", "-o", "out.exr", *FAST)
FULL = (*SHORT, "--disparity", "disparity.png", "--blur", 6, "--focus", 0.4)

# Options of bokehnet render before there were settings; each of them works as ever.
EARLIER = """
output disparity depth channel depth-unit invert disparity-range blur focus focal-length f-number
focus-distance sensor-width focus-at focus-range focus-plane tilt-x tilt-y resize-disparity mixed-depth
refine-disparity engine preset blades blade-curvature aperture-rotation squeeze cats-eye aperture-image rim
obstruction onion onion-rings disc-grain disc-grain-seed gamma highlights highlight-gain lens aberrations
lens-f-number lens-distortion spherical coma astigmatism field-curvature axial-fringe lateral-fringe axial-map
lateral-map fringe-glass dispersion equaliser distortion distortion-brown cos4 optical-vignetting vignette
vignette-radius vignette-softness vignette-roundness grain grain-size grain-mono grain-seed frames jobs
overwrite focus-from focus-to f-number-from f-number-to blur-from blur-to pull save-maps weights max-memory
"""


@pytest.fixture
def picture(folder, cli):
    """Run a command line that must succeed silently, and return the bytes that it wrote."""

    def call(*arguments):
        outcome = cli(*arguments, "-q")
        assert (outcome.code, outcome.out, outcome.err) == (0, "", "")
        return (folder / "out.exr").read_bytes()

    return call


def render_command():
    from bokehnet.cli.app import app

    return app.commands["render"]


def shown_flags(text):
    return set(re.findall(r"^  (?:-\w, )?--([a-z0-9-]+)", text, re.MULTILINE))


@pytest.mark.parametrize("command", ["render", "studio"])
def test_complete_help_has_a_section_for_every_group(cli, command):
    outcome = cli(command, "--help-all")
    assert (outcome.code, outcome.err) == (0, "")
    titles = [line[:-1] for line in outcome.out.splitlines() if re.fullmatch(r"\S.*:", line)]
    groups = [group.TITLE for group in group_types()]
    groups += [SequenceSettings.TITLE] if command == "render" else []
    assert [title for title in titles if title in groups] == list(dict.fromkeys(groups))
    assert len(titles) == len(set(titles))
    assert max(map(len, outcome.out.splitlines())) <= 100


def test_help_lists_every_setting_and_hides_deprecated_names(cli):
    known = [*all_settings().values(), *field_settings(SequenceSettings).values()]
    shown = shown_flags(cli("render", "--help-all").out)
    assert {item.flag for item in known if item.flag} <= shown
    assert not {alias for item in known for alias in item.aliases} & shown
    assert "as-stored" not in shown
    assert {flag for flag in shown if flag.startswith("no-")} == {"no-data"}  # a setting, no negation


@pytest.mark.parametrize("command", ["render", "compare", "studio"])
def test_short_help_fits_a_screen_and_names_every_group(cli, command):
    lines = cli(command, "--help").out.splitlines()
    assert len(lines) <= 45
    assert max(map(len, lines)) <= 80
    known = all_settings().values()
    shown = shown_flags("\n".join(lines))
    assert {"disparity", "depth", "blur", "f-number", "focus-at"} <= shown
    assert len(shown) <= 22
    names = lines[next(i for i, line in enumerate(lines) if "--help-all" in line) :]
    words = re.findall(r"[a-z]+", " ".join(names))
    assert {item.group for item in known} - set(words) <= (
        {"engine", "output"} if command == "compare" else set()
    )


def test_examples_of_the_short_help_parse(cli):
    lines = cli("render", "--help").out.splitlines()
    examples = [line.split()[2:] for line in lines if line.startswith("  bokehnet render ")]
    assert len(examples) == 4
    for words in examples:
        render_command().make_context("render", words)


@pytest.mark.parametrize("word", ["aperture", "blades"])
def test_help_of_a_group_shows_its_options_only(cli, word):
    outcome = cli("render", "--help", word)
    known = [item for item in all_settings().values() if item.group == "aperture" and item.flag]
    assert (outcome.code, outcome.err) == (0, "")
    assert shown_flags(outcome.out) == {item.flag for item in known}


def test_help_of_an_unknown_group_names_the_groups(cli):
    outcome = cli("render", "--help", "apertur")
    assert outcome.code == 1
    assert "--help: expected one of input, depth, focus, camera, aperture" in outcome.err


def test_every_earlier_option_is_still_there():
    flags = {name.lstrip("-") for parameter in render_command().params for name in parameter.opts}
    assert set(EARLIER.split()) <= flags


@pytest.mark.parametrize(
    "command", ["", "render", "demo", "depth", "export", "info", "lens", "presets", "trace"]
)
def test_every_command_has_both_help_flags(cli, command):
    outcomes = [cli(*command.split(), flag) for flag in ("-h", "--help")]
    assert [outcome.code for outcome in outcomes] == [0, 0]
    assert outcomes[0].out == outcomes[1].out
    assert outcomes[0].out.startswith("Usage: bokehnet")


def test_the_package_runs_as_a_module_and_without_its_name(cli_process):
    assert cli_process("--version").out.startswith("bokehnet ")
    bare = cli_process()
    assert (bare.code, bare.err) == (0, "")
    assert "render" in bare.out


def test_help_of_render_imports_nothing_heavy(python_process):
    source = (
        "import sys; from bokehnet.cli.app import run\n"
        "assert run(['render', '-h']) == 0\n"
        "heavy = {'numpy', 'numba', 'torch', 'OpenImageIO', 'onnxruntime', 'tqdm'} & set(sys.modules)\n"
        "sys.exit(', '.join(heavy) or 0)"
    )
    outcome = python_process(source)
    assert (outcome.code, outcome.err) == (0, "")


def completed(words, tmp_path, last):
    """Return the completions of the last word. Authority: click's protocol for Bash."""
    environment = {
        **os.environ,
        "_BOKEHNET_COMPLETE": "bash_complete",
        "COMP_WORDS": " ".join(words),
        "COMP_CWORD": str(last),
    }
    source = "from bokehnet.cli.app import main; main()"
    done = subprocess.run(
        [sys.executable, "-c", source], env=environment, capture_output=True, text=True, check=False
    )
    assert done.stderr == ""
    return [line.partition(",")[2] for line in done.stdout.splitlines() if line.startswith("plain,")]


def test_a_script_completes_in_the_shell(cli):
    outcome = cli("--show-completion", "bash")
    assert (outcome.code, outcome.err) == (0, "")
    assert "_BOKEHNET_COMPLETE=bash_complete" in outcome.out
    assert "complete -o nosort -F _bokehnet_completion bokehnet" in outcome.out


@pytest.mark.slow
def test_completion_offers_commands_choices_and_presets(tmp_path):
    assert completed(["bokehnet", "pre"], tmp_path, 1) == ["presets"]
    assert completed(["bokehnet", "render", "a.png", "--engine", "s"], tmp_path, 4) == ["scatter"]
    assert set(completed(["bokehnet", "render", "--mixed-depth", ""], tmp_path, 3)) == {"auto", "on", "off"}
    assert "petzval-swirl" in completed(["bokehnet", "render", "--preset", "pet"], tmp_path, 3)


def test_the_earlier_name_of_the_repair_works(picture):
    expected = picture(*FULL, "--repair-disparity", "on")
    words = [word for word in FULL if word not in ("--repair-disparity", "off")]
    assert picture(*words, "--refine-disparity", "on") == expected


def test_both_names_of_one_option_are_too_many(fails):
    words = [word for word in FULL if word not in ("-o", "out.exr")]
    fails(
        [*words, "--refine-disparity", "off"], "--repair-disparity: expected one of its two names, got both"
    )
    fails([*words, "--invert", "--no-invert"], "--invert: expected one of its two names, got both")


def test_no_options_undo_presets_and_files(folder, picture):
    plain, inverted = picture(*FULL), picture(*FULL, "--invert")
    assert plain != inverted
    (folder / "mine.toml").write_text('[input]\ndisparity = "disparity.png"\n[depth]\ninvert = true\n')
    words = (*SHORT, "--settings", "mine.toml", "--blur", 6, "--focus", 0.4)
    assert picture(*words) == inverted
    assert picture(*words, "--no-invert") == plain
    (folder / "look.toml").write_text("grain = 3200\ngrain-mono = true\n")
    grey = picture(*FULL, "--preset", "look.toml")
    assert (
        picture(*FULL, "--preset", "look.toml", "--no-grain-mono") == picture(*FULL, "--grain", 3200) != grey
    )


@pytest.mark.parametrize(
    ("options", "field"),
    [
        (["--rim", -0.5], ("aperture", "spherical_profile", -0.5)),
        (["--rim=-0.5"], ("aperture", "spherical_profile", -0.5)),
        (["--vignette", "-2"], ("effects", "vignette", -2)),
        (["--distortion-brown", "-0.01,0.002"], ("effects", "brown", (-0.01, 0.002))),
        (["--focus-range", "0.1,0.3"], ("focus", "range", (0.1, 0.3))),
        (["--disparity-range", "-1,2"], ("depth", "value_range", (-1, 2))),
        (["--tilt-x", "-1e1"], ("focus", "tilt_x", -10)),
        (["--focus-plane", "1,2", "30,4", "5,30"], ("focus", "plane", ((1, 2), (30, 4), (5, 30)))),
        (["--max-memory", "2 GiB"], ("engine", "max_memory", 2**31)),
    ],
)
def test_values_arrive_as_they_were_typed(folder, picture, options, field):
    """Read back from the settings that lie beside the maps."""
    words = FULL if field[0] != "focus" or field[1] == "tilt_x" else FULL[:-2]
    picture(*words, "--save-maps", "maps", *options)
    group, name, value = field
    assert getattr(getattr(load_settings("maps/settings.toml"), group), name) == value


def test_the_last_of_two_values_counts(picture):
    assert picture(*FULL, "--focus", 0.9) == picture(*FULL[:-1], 0.9)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--bokeh", 3], ["--bokeh"]),
        (["--blur", "--focus"], ["--blur"]),
        (["--invert=yes"], ["--invert"]),
        (["extra.png"], ["extra.png"]),
        (["--as-stored"], ["--as-stored"]),
        (["--no-blur"], ["--no-blur"]),
        (["--jobs", 0, "--frames", "1"], ["--jobs: expected a whole number of at least 1, got 0"]),
    ],
)
def test_unknown_options_are_reported_in_one_line(fails, options, words):
    arguments = [word for word in FULL if word not in ("-o", "out.exr")]
    fails([*arguments, *options], *words)


def test_a_settings_file_is_the_options_that_it_names(folder, picture):
    expected = picture(*FULL, "--blades", 6, "--grain", 1600, "--grain-seed", 3)
    (folder / "mine.toml").write_text(
        '[input]\ndisparity = "disparity.png"\n[camera]\nblur = 6\n[focus]\nvalue = 0.4\n'
        "[aperture]\nblades = 6\n[effects]\ngrain = 1600\ngrain_seed = 3\n"
        '[depth]\nrepair = "off"\n[engine]\nname = "scatter"\n'
    )
    assert picture("render", "photo.png", "-o", "out.exr", "--settings", "mine.toml") == expected
    # An option overrides it, and so does a preset.
    other = picture("render", "photo.png", "-o", "out.exr", "--settings", "mine.toml", "--blades", 7)
    assert other == picture(*FULL, "--blades", 7, "--grain", 1600, "--grain-seed", 3) != expected
    (folder / "look.toml").write_text("blades = 8\ngrain = 100\n")
    words = ("--settings", "mine.toml", "--preset", "look.toml", "--grain", 1600)
    layered = picture("render", "photo.png", "-o", "out.exr", *words)
    assert layered == picture(*FULL, "--blades", 8, "--grain", 1600, "--grain-seed", 3)


def test_what_save_maps_writes_renders_the_same_again(folder, picture):
    options = ("--blades", 5, "--blade-curvature", 0.4, "--vignette", -1, "--highlights", 0.7)
    expected = picture(*FULL, *options, "--save-maps", "maps")
    (folder / "out.exr").unlink()
    again = ("render", "photo.png", "-o", "out.exr", "--settings", "maps/settings.toml")
    assert picture(*again) == expected


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (None, ["cannot read settings mine.toml: No such file"]),
        ("blads = 3\n", ["mine.toml: unknown option 'blads'", "blades"]),
        ("[camera]\nblur = -1\n", ["mine.toml: --blur: expected a number of at least 0 pixels, got -1"]),
        ("[camera\n", ["mine.toml: expected TOML"]),
        (
            '[input]\ndisparity = "disparity.png"\ndepth = "camera.exr"\n',
            ["--disparity and --depth, got both"],
        ),
        ("[sequence]\nframes = [1]\n", ["unknown option 'sequence'"]),
    ],
)
def test_a_settings_file_that_is_wrong_is_reported(folder, fails, text, words):
    if text is not None:
        (folder / "mine.toml").write_text(text)
    fails(["render", "photo.png", *FAST, "--settings", "mine.toml"], *words)


def test_an_option_that_is_wrong_is_not_blamed_on_the_settings_file(folder, cli):
    (folder / "mine.toml").write_text("[aperture]\nblades = 5\n")
    words = ["render", "photo.png", *FAST, "--settings", "mine.toml", "--blades", "2", "-o", "out.png"]
    outcome = cli(*words)
    assert outcome.code == 1
    assert outcome.err.startswith("bokehnet: error: --blades: expected 0 (disc) or 3 to 16, got 2")


def test_a_defocus_map_is_rendered_as_it_is(folder, picture):
    """Oracle: the disparity that it was made of."""
    expected = picture(*FULL)
    write_map("radii.exr", 6 * (read_disparity("disparity.png") - np.float32(0.4)))
    assert picture(*SHORT, "--defocus-map", "radii.exr", "--save-maps", "maps") == expected
    assert_array_equal(read_map("maps/defocus.exr"), read_map("radii.exr"))


def test_defocus_maps_may_be_a_sequence(folder, cli):
    for frame in (1, 2):
        write_map(f"radii.{frame}.exr", frame * (read_disparity("disparity.png") - np.float32(0.4)))
    words = (
        "render",
        "photo.png",
        *FAST,
        "--frames",
        "1-2",
        "-o",
        "out.#.exr",
        "--defocus-map",
        "radii.#.exr",
    )
    assert cli(*words).code == 0
    assert cli(*SHORT, "--defocus-map", "radii.2.exr").code == 0
    assert_array_equal(read_image("out.2.exr"), read_image("out.exr"))


def test_a_constant_disparity_blurs_evenly(folder, picture):
    picture(*SHORT, "--constant-disparity", 0.9, "--blur", 10, "--focus", 0.4, "--save-maps", "maps")
    assert_allclose(read_map("maps/defocus.exr"), 5, rtol=1e-6)


@pytest.fixture
def network(folder, write_red_network):
    """tiny.onnx, which returns the red channel that it sees, as disparity or, by metric.toml, as depth."""
    write_red_network(folder)


def test_a_network_in_one_go_is_the_network_in_two(network, folder, picture, cli):
    """Oracle: bokehnet depth, and its map given to bokehnet render."""
    convention = ("--convention", "tiny.toml")
    assert cli("depth", "photo.png", "-o", "map.exr", "--model", "tiny.onnx", *convention).code == 0
    words = ("--blur", 6, "--focus", 0.4)
    two = picture(*SHORT, "--disparity", "map.exr", "--disparity-range", "0,1", *words)
    model = ("--depth-model", "tiny.onnx", "--depth-convention", "tiny.toml")
    assert picture(*SHORT, *model, *words) == two


def test_a_metric_network_takes_a_camera(network, folder, picture, cli):
    model = ("--depth-model", "tiny.onnx", "--depth-convention", "metric.toml")
    lens = ("--focal-length", 50, "--f-number", 2, "--sensor-width", 36, "--focus-distance", 4)
    picture(*SHORT, *model, *lens, "--save-maps", "maps")
    defocus = read_map("maps/defocus.exr")
    assert defocus.min() < 0 < defocus.max()
    outcome = cli(*SHORT, *model, "--blur", 5, "--focus", 0.5)
    assert outcome.code == 1
    assert "does not apply to --depth-model" in outcome.err


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--constant-disparity", 1.5], ["--constant-disparity: expected 0 to 1, got 1.5"]),
        (["--constant-disparity", 0.5], ["--constant-disparity needs --blur"]),
        (["--constant-disparity", 0.5, "--blur", 3], ["expected one of --focus, --focus-at"]),
        (
            ["--constant-disparity", 0.5, "--disparity", "disparity.png"],
            ["--disparity and --constant-disparity"],
        ),
        (["--defocus-map", "disparity.png", "--blur", 3], ["--defocus-map: expected no camera and no tilt"]),
        (
            ["--defocus-map", "camera.exr", "--focus", 0.5],
            ["--focus: expected nothing: --defocus-map is already focused"],
        ),
        (["--defocus-map", "missing.exr"], ["missing.exr: no such file"]),
        (
            ["--depth-model", "missing.onnx", "--blur", 3, "--focus", 0.5],
            ["missing.onnx: expected an ONNX file"],
        ),
        (["--depth-convention", "midas"], ["--depth-convention: expected --depth-model for it to act on"]),
        (["--depth-model", "photo.png", "--channel", "Z"], ["--channel: expected --disparity, --depth or"]),
    ],
)
def test_a_mistake_about_the_other_sources_is_reported(fails, options, words):
    fails(["render", "photo.png", *FAST, *options], *words)


def test_an_option_takes_the_place_of_the_way_that_a_settings_file_goes(folder, cli):
    """Oracle: the same without what the file says of the focus."""
    (folder / "with.toml").write_text('[input]\ndisparity = "disparity.png"\n[focus]\nvalue = 0.9\n')
    (folder / "without.toml").write_text('[input]\ndisparity = "disparity.png"\n')
    pictures = []
    for name in ("with", "without"):
        words = ("--settings", f"{name}.toml", "--blur", 6, "--focus-at", "30,5", "--engine", "scatter")
        assert cli("render", "photo.png", *words, "-o", f"{name}.png").code == 0
        pictures.append((folder / f"{name}.png").read_bytes())
    assert pictures[0] == pictures[1]
