"""``bokehnet compare``: lines, a sheet, a page, and what it refuses."""

import re

import numpy as np
import pytest

from bokehnet import BokehRenderer, read_image, write_image
from bokehnet.io.color.srgb import linear_to_srgb
from bokehnet.scores.similarity import psnr
from bokehnet.tools.comparison import largest_difference_crops


@pytest.fixture
def scene(tmp_path):
    rng = np.random.default_rng(7)
    image = rng.random((60, 90, 3)).astype(np.float32)
    disparity = np.full((60, 90), 0.2, np.float32)
    disparity[20:40, 30:60] = 1
    write_image(tmp_path / "in.exr", image)
    write_image(tmp_path / "d.exr", np.repeat(disparity[..., None], 3, axis=2))
    defocus = (disparity - 0.2) * 10
    truth = BokehRenderer("rays").render_arrays(read_image(tmp_path / "in.exr"), defocus).bokeh
    write_image(tmp_path / "truth.exr", truth)
    words = ["compare", tmp_path / "in.exr", "--disparity", tmp_path / "d.exr", "--disparity-range", "0,1"]
    words += ["--blur", 10, "--focus", 0.2, "--repair-disparity", "off"]
    return tmp_path, words, truth


def test_a_line_for_each_engine_a_sheet_and_a_page(scene, cli):
    folder, words, _ = scene
    files = ["-o", folder / "sheet.png", "--html", folder / "page.html", "--truth", folder / "truth.exr"]
    done = cli(*words, *files, "--engines", "rays,diffusion,scatter")
    assert done.code == 0, done.err
    lines = done.out.splitlines()
    assert [line.split()[0] for line in lines] == ["rays", "diffusion", "scatter"]
    reports = [float(re.search(r"([\d.]+) dB", line)[1]) for line in lines]
    assert reports[0] > 50 > reports[2] > reports[1] - 20
    bokeh = (
        BokehRenderer("diffusion")
        .render_arrays(read_image(folder / "in.exr"), (read_image(folder / "d.exr")[..., 0] - 0.2) * 10)
        .bokeh
    )
    shown = [linear_to_srgb(np.clip(x, 0, 1)) for x in (read_image(folder / "truth.exr"), bokeh)]
    assert reports[1] == pytest.approx(psnr(*shown), abs=0.1)
    sheet = read_image(folder / "sheet.png")
    assert sheet.shape[0] > 4 * 2 * 60
    page = (folder / "page.html").read_text(encoding="utf-8")
    assert page.count("data:image/png;base64,") == 5
    assert page.count("<tr>") == 4
    names = re.findall(r'"([^"]+)": "data', page)
    assert names == ["in focus", "truth", "rays", "diffusion", "scatter"]


def test_without_a_truth_nothing_is_scored(scene, cli):
    folder, words, _ = scene
    done = cli(*words, "-o", folder / "sheet.png", "--crop", "10,5,30,20")
    assert done.code == 0, done.err
    assert "dB" not in done.out
    assert [line.split()[0] for line in done.out.splitlines()] == ["scatter", "rays"]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--engines", "rays,rays"], "--engines: expected one or more engines, each once"),
        (["--engines", ""], "--engines: expected one or more"),
        (["--engines", "rays,nothing"], "--engines: expected one of"),
        (["--crop", "1,2,3"], "--crop: expected four whole numbers"),
        (["--crop", "80,0,20,20"], "--crop: expected a part of the picture's 90x60"),
        (["--engines", "rays,diffusion", "--blades", "5"], "diffusion"),
    ],
)
def test_bad_input_is_reported_in_one_line_and_nothing_is_written(scene, cli, options, message):
    folder, words, _ = scene
    done = cli(*words, "-o", folder / "sheet.png", *options)
    assert done.code == 1
    assert message in done.err
    assert done.err.count("error:") == 1
    assert not (folder / "sheet.png").exists()


def test_a_truth_of_another_size_is_refused(scene, cli):
    folder, words, truth = scene
    write_image(folder / "small.exr", truth[1:])
    done = cli(*words, "-o", folder / "sheet.png", "--truth", folder / "small.exr")
    assert done.code == 1
    assert "truth" in done.err
    assert not (folder / "sheet.png").exists()


def test_places_are_where_engines_differ():
    from bokehnet.tools.comparison import EngineComparison

    flat = np.full((100, 120, 3), 0.5, np.float32)
    other = flat.copy()
    other[70:90, 80:110] = 1
    results = [EngineComparison(engine=name, bokeh=x, seconds=0.0) for name, x in (("a", flat), ("b", other))]
    left, top, width, height = largest_difference_crops(results, size=30, count=1)[0]
    assert (width, height) == (30, 30)
    assert top <= 75 <= top + 30
    assert left <= 85 <= left + 30
