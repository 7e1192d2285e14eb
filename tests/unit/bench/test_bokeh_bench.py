"""The benchmark package of ``bench/``: its tracer, maps, metrics, commands and page."""

import ast
import json
import shlex
import subprocess
import sys
import venv
from pathlib import Path

import numpy as np
import pytest

BENCH = Path(__file__).parents[3] / "bench"
sys.path.insert(0, str(BENCH))

from bokeh_bench import (  # noqa: E402
    __main__,
    dataset,
    filters,
    leaderboard,
    maps,
    methods,
    metrics,
    scenes,
    stereo,
    tracing,
)
from bokeh_bench.files import BenchError, read_picture, write_grey16, write_pfm  # noqa: E402
from bokeh_bench.surfaces import Card, Outline, Sphere, Texture  # noqa: E402

WHITE = Texture(color=(1.0, 1.0, 1.0), waves=np.zeros((0, 4), np.float32))
BLACK_SKY = np.zeros((2, 3))


@pytest.fixture(scope="module")
def small():
    """Patch the size and the number of rays for the whole module."""
    with pytest.MonkeyPatch.context() as patch:
        for module in (scenes, maps, stereo):
            patch.setattr(module, "WIDTH", 64)
            patch.setattr(module, "HEIGHT", 48)
        patch.setattr(scenes.camera, "__defaults__", (None, 64, 48, 0.0))
        patch.setattr(dataset, "HALF_SAMPLES", 4)
        patch.setattr(dataset, "IMAGE_SAMPLES", 4)
        yield


@pytest.fixture(scope="module")
def folder(small, tmp_path_factory):
    """Two small scenes, and their pins."""
    result = tmp_path_factory.mktemp("bench")
    pins = {name: dataset.make_scene(name, result / name)["pins"] for name in ("table", "lamps")}
    (result / "pins.json").write_text(json.dumps(pins))
    return result


@pytest.fixture
def run(folder, monkeypatch, capsys):
    monkeypatch.setattr(__main__, "PINS", folder / "pins.json")

    def call(*arguments):
        where = ["--folder", folder, "--scene", "table"] if arguments[0] == "run" else []
        __main__.main([str(part) for part in (*arguments, *where)])
        return capsys.readouterr().out

    return call


def test_the_package_imports_nothing_but_numpy_and_pillow():
    """Authority: the dependencies of its own project file."""
    roots = set()
    for path in (BENCH / "bokeh_bench").glob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Import):
                roots |= {alias.name.split(".")[0] for alias in node.names}
            elif isinstance(node, ast.ImportFrom):
                roots.add((node.module or "").split(".")[0])
    assert roots - set(sys.stdlib_module_names) == {"numpy", "PIL", "bokeh_bench"}


@pytest.mark.parametrize("blades", [0, 6])
def test_an_edge_before_black_has_the_profile_of_the_pupil(blades):
    """Authority: the fraction of the pupil on one side of a line, counted on a fine grid."""
    edge = Card(center=(0, 0, 0.8), texture=WHITE, outline=Outline(kind="box", size=(1.0, 9.0)))
    edge = Card(center=(1.0, 0, 0.8), texture=WHITE, outline=edge.outline)  # covers x > 0
    camera = tracing.Camera(width=60, height=4, slope=0.01, blur=40.0, focus=1.6, blades=blades)
    radius = float(tracing.blur_radius(camera, np.array(0.8)))
    assert radius == pytest.approx(25)
    picture = tracing.render([edge], BLACK_SKY, camera, 1024, 3)[:, :, 0].mean(0)
    y, x = np.mgrid[-1000:1001, -1000:1001] / 1000
    inside = tracing._in_pupil(camera, np.stack([x.ravel(), y.ravel()], -1)).reshape(x.shape)
    at = np.arange(60) + 0.5 - 30
    # Covered where p - r u > 0.
    expected = [(inside & (radius * x < p)).sum() / inside.sum() for p in at]
    assert np.abs(picture - expected).max() < 0.03


def test_a_lamp_sampled_directly_is_the_lamp_sampled_by_the_pupil():
    """Authority: the tracer without direct sampling, at many rays; behind it another object covers half."""
    lamp = Card(center=(0, 0, 4.0), texture=WHITE, outline=Outline(kind="disc", size=(0.08, 0.08)), lamp=True)
    cover = Card(center=(0.4, 0, 1.0), texture=WHITE, outline=Outline(kind="box", size=(0.4, 1.0)))
    camera = tracing.Camera(width=32, height=32, slope=0.01, blur=12.0, focus=1.5)
    direct = tracing.render([lamp, cover], BLACK_SKY, camera, 64, 1)
    plain = Card(center=lamp.center, texture=WHITE, outline=lamp.outline)
    brute = tracing.render([plain, cover], BLACK_SKY, camera, 4096, 2)
    assert np.abs(direct - brute)[:, :14].mean() < 0.01
    assert direct[:, :14].sum() == pytest.approx(brute[:, :14].sum(), rel=0.03)


def test_spheres_and_planes_are_hit_where_their_equations_hold():
    """Authority: the implicit equations at the hit."""
    rng = np.random.default_rng(0)
    slope = rng.uniform(-0.3, 0.3, (500, 2)).astype(np.float32)
    origin = rng.uniform(-0.02, 0.02, (500, 2)).astype(np.float32)
    sphere = Sphere(center=(0.1, -0.1, 2.0), radius=0.5, texture=WHITE)
    z = sphere.hit(origin, slope)
    hit = np.isfinite(z)
    assert 50 < hit.sum() < 450
    point = np.c_[origin + slope * z[:, None], z][hit]
    assert np.linalg.norm(point - sphere.center, axis=1) == pytest.approx(0.5, abs=1e-4)
    plane = Card(center=(0.2, 0.1, 3.0), texture=WHITE, gradient=(0.4, -0.3))
    z = plane.hit(origin, slope)
    x, y = (origin + slope * z[:, None]).T
    assert z == pytest.approx(3.0 + 0.4 * (x - 0.2) - 0.3 * (y - 0.1), abs=1e-4)


def test_metrics_are_those_of_the_renderer_and_of_scikit_image():
    """Authority: the scores of bokehnet, and SSIM of scikit-image, on the same pictures."""
    ssim = pytest.importorskip("skimage.metrics", reason="needs scikit-image").structural_similarity
    from bokehnet.scores.flip import flip_map

    rng = np.random.default_rng(1)
    truth = np.clip(rng.random((60, 80, 3)) * np.linspace(0.2, 1, 80)[:, None], 0, 1)
    other = np.clip(truth + rng.normal(0, 0.05, truth.shape), 0, 1)
    assert metrics.flip(truth, other) == pytest.approx(float(flip_map(truth, other).mean()), abs=1e-5)
    expected = ssim(
        truth,
        other,
        channel_axis=2,
        data_range=1.0,
        gaussian_weights=True,
        sigma=1.5,
        use_sample_covariance=False,
    )
    assert metrics.ssim(truth, other) == pytest.approx(expected, abs=1e-6)


def test_the_edge_mask_is_the_reach_of_depth_steps():
    """Authority: distances to the steps, pixel by pixel."""
    depth = np.full((20, 30), 2.0)
    depth[:, 12:] = 4.0
    radius = np.where(depth == 2.0, 3.5, -1.0)
    mask = metrics.edge_mask(depth, radius)
    columns = np.nonzero(mask[10])[0]
    assert list(columns) == list(range(11 - 4, 12 + 4 + 1))


def test_maps_of_estimators_have_their_faults(folder):
    """Authority: the mechanism of each estimator."""
    scene = scenes.draw("table")
    image = read_picture(folder / "table/image.pfm")
    truth = 1 / maps.depth_map("exact", scene, image)
    inverse = {kind: 1 / maps.depth_map(kind, scene, image) for kind in maps.KINDS}
    scale = truth.max() - truth.min()
    levels = np.unique(inverse["eight_bit"])
    assert len(levels) <= 256
    assert np.abs(inverse["eight_bit"] - truth).max() <= scale / 510 + 1e-9
    edges = metrics.edge_mask(1 / truth, np.ones_like(truth))[:, 20:]  # the second camera sees the rest
    for kind in set(maps.KINDS) - {"exact", "eight_bit"}:
        error = np.abs(inverse[kind] - truth)[:, 20:]
        assert error[edges].mean() > 1.5 * error[~edges].mean(), kind
        assert np.isfinite(inverse[kind]).all()
    for kind in ("stereo", "semi_global", "sparse"):
        assert np.median(np.abs(inverse[kind] - truth)) < 0.1 * scale


def test_costs_along_a_path_are_those_of_the_recurrence():
    """Authority: equation (13) of Hirschmueller, pixel by pixel and disparity by disparity."""
    rng = np.random.default_rng(4)
    costs, grey = rng.integers(0, 24, (5, 6, 4)).astype(float), rng.random((5, 6))
    for step in stereo._PATHS:
        found = stereo._along_path(costs, grey, step)
        for y, x in np.ndindex(5, 6):
            # Before the first line of the path nothing is added; beside the picture its border is repeated.
            if step[0] == 0:
                before = (y, x - step[1]) if 0 <= x - step[1] < 6 else None
            else:
                row, column = y - step[0], min(max(x - step[1], 0), 5)
                before = (row, column) if 0 <= row < 5 else None
            expected = costs[y, x].copy()
            if before is not None:
                last, least = found[before], found[before].min()
                large = max(
                    stereo._LARGE_STEP / (1 + abs(grey[y, x] - grey[before]) / stereo._EDGE),
                    2 * stereo._SMALL_STEP,
                )
                for d in range(4):
                    steps = [last[e] + stereo._SMALL_STEP for e in (d - 1, d + 1) if 0 <= e < 4]
                    expected[d] += min(last[d], *steps, least + large) - least
            assert found[y, x] == pytest.approx(expected)


def test_laser_points_lie_on_the_surfaces(small):
    """Authority: the plane's equation, and the noise along the ray."""
    wall = Card(center=(0, 0, 2.0), texture=WHITE, gradient=(0.3, -0.2))
    scene = scenes.Scene(name="wall", surfaces=[wall], sky=BLACK_SKY, shots=[])
    points = maps.laser_points(scene)
    rows, columns = np.nonzero(points)
    assert len(rows) > 0.5 * points.size
    slope = (np.stack([columns, rows], -1) + 0.5 - [32, 24]) * scenes.camera().slope
    expected = 2.0 / (1 - slope @ [0.3, -0.2])
    half_pixel = 0.5 * scenes.camera().slope * 0.5 * expected
    error = np.abs(1 / points[rows, columns] - expected)
    assert (error < 5 * maps._LASER_NOISE + half_pixel * expected).all()
    dense = maps.depth_map("sparse", scene, np.empty(0))
    exact = maps.depth_map("exact", scene, np.empty(0))
    assert np.abs(dense / exact - 1).max() < 0.05


def test_dilation_is_the_maximum_over_a_square():
    """Authority: the maximum, window by window."""
    values = np.random.default_rng(5).random((9, 11))
    found = filters.dilated(values, 5)
    for y, x in np.ndindex(values.shape):
        window = values[max(y - 2, 0) : y + 3, max(x - 2, 0) : x + 3]
        assert found[y, x] == window.max()


def test_damaged_pins_end_the_run(folder, run):
    pins = json.loads((folder / "pins.json").read_text())
    pins["table"][0][0] += 0.5
    (folder / "other.json").write_text(json.dumps(pins))
    description = json.loads((folder / "table/scene.json").read_text())
    with pytest.raises(BenchError, match="block means that differ"):
        dataset.check(folder / "table", description, pins["table"])


def test_a_command_a_function_and_a_builtin_agree(run, folder, tmp_path, monkeypatch):
    """Authority: three ways to return the input have the scores of no blur."""
    (tmp_path / "copy_method.py").write_text(
        "import shutil, sys\n\ndef same(case):\n    return case.image\n\n"
        "if __name__ == '__main__':\n    shutil.copy(sys.argv[1], sys.argv[2])\n"
    )
    monkeypatch.syspath_prepend(str(tmp_path))
    script = shlex.quote(str(tmp_path / "copy_method.py"))
    outputs = []
    for way in (
        ("--builtin", "no_blur"),
        ("--function", "copy_method:same"),
        ("--command", f"{shlex.quote(sys.executable)} {script} {{image}} {{out}}"),
    ):
        track = ["--track", "exact"]
        outputs.append(run("run", *way, "--name", "copy", *track, "--json", tmp_path / "copy.json"))
        result = json.loads((tmp_path / "copy.json").read_text())
        assert result["scenes"]["table"]["exact"]["psnr"] < 40
    assert len({text.split("|")[-9] for text in outputs}) == 1
    assert "Noise of the truth" in outputs[0]


@pytest.mark.parametrize(
    ("command", "message"),
    [
        ("true {image}", "expected {out} or {out_png}"),
        ("true {picture} {out}", "found picture"),
        ("false {out}", "exit status 1"),
        ("true {out}", "found none"),
    ],
)
def test_bad_commands_end_with_one_line(run, command, message):
    with pytest.raises(SystemExit) as ended:
        run("run", "--command", command, "--track", "exact")
    assert message in str(ended.value)
    assert "\n" not in str(ended.value)


def test_placeholders_give_the_blur_of_the_map(folder):
    """Authority: the formula of the README, in metres, with the depth that is written."""
    description = json.loads((folder / "table/scene.json").read_text())
    for case in dataset.cases(folder / "table", description, "exact"):
        focal, focus = case.focal_length / 1000, case.focus
        slope = focal**2 / (2 * case.f_number) * focus / (focus - focal)
        expected = slope * (1 / case.depth - 1 / focus) * 64 / (case.sensor_width / 1000)
        assert case.defocus == pytest.approx(expected, rel=1e-5)
        values = methods.placeholders(case, description, folder)
        disparity = read_picture(folder / "table/disparity_exact.png")
        by_disparity = float(values["blur"]) * (disparity - float(values["focus"]))
        assert np.abs(by_disparity - expected).max() < 0.02


def test_the_page_holds_every_picture(run, folder, tmp_path):
    for name in methods.BUILTIN:
        kind = ["--builtin", name, "--track", "exact", "--track", "clipped"]
        run("run", *kind, "--json", tmp_path / f"{name}.json", "--pictures", tmp_path / "pictures")
    files = [tmp_path / f"{name}.json" for name in methods.BUILTIN]
    site = tmp_path / "site"
    run("page", *files, "--folder", folder, "--pictures", tmp_path / "pictures", "--out", site)
    page = (site / "index.html").read_text()
    assert 'type="range"' in page
    assert "gather" in page
    kinds = [f"{shot}_{track}" for shot in (0, 1) for track in ("exact", "clipped")]
    names = {f"{method}_table_{kind}.png" for method in methods.BUILTIN for kind in kinds}
    assert names <= {path.name for path in (site / "pictures").iterdir()}
    (tmp_path / "pictures/gather_table_0_exact.png").unlink()
    with pytest.raises(SystemExit, match="found none"):
        run("page", *files, "--folder", folder, "--pictures", tmp_path / "pictures", "--out", site)


def test_pfm_and_grey_files_are_read_back(tmp_path):
    values = np.random.default_rng(2).random((5, 7, 3)).astype(np.float32)
    write_pfm(tmp_path / "a.pfm", values)
    assert (read_picture(tmp_path / "a.pfm") == values).all()
    write_grey16(tmp_path / "a.png", values[..., 0])
    assert np.abs(read_picture(tmp_path / "a.png") - values[..., 0]).max() < 1e-5
    (tmp_path / "b.pfm").write_bytes(b"PF\n3 3\n-1.0\nxx")
    with pytest.raises(BenchError, match="expected a portable float map"):
        read_picture(tmp_path / "b.pfm")


def test_the_board_keeps_the_rows_of_other_methods(tmp_path):
    board, version = tmp_path / "board.json", leaderboard.VERSION
    first = {"benchmark": version, "method": "first", "tracks": {}, "rows": [1]}
    leaderboard.add_to_board(board, [first, {**first, "method": "second"}])
    leaderboard.add_to_board(board, [{**first, "tracks": {"exact": {}}}])
    rows = json.loads(board.read_text())
    assert [row["method"] for row in rows] == ["first", "second"]
    assert rows[0]["tracks"] == {"exact": {}}
    assert all("rows" not in row for row in rows)


def test_the_readme_shows_the_leaderboard(capsys):
    """Authority: the table that the command prints from the stored results."""
    __main__.main(["table"])
    assert capsys.readouterr().out.strip() in (BENCH / "README.md").read_text(encoding="utf-8")


@pytest.mark.slow
def test_it_runs_in_an_environment_of_its_own(tmp_path):
    """Authority: its own console script in an empty environment, where the renderer is absent."""
    venv.create(tmp_path / "env", with_pip=True)
    python = tmp_path / "env/bin/python"
    install = [python, "-m", "pip", "install", "-q", "--no-cache-dir", BENCH]
    done = subprocess.run(install, capture_output=True, text=True, check=False)
    if done.returncode:
        pytest.skip(f"needs the package index: {done.stderr.strip().splitlines()[-1]}")
    absent = subprocess.run([python, "-c", "import bokehnet"], capture_output=True, check=False, cwd=tmp_path)
    assert absent.returncode
    table = [tmp_path / "env/bin/bokeh-bench", "table"]
    listed = subprocess.run(table, capture_output=True, text=True, check=True)
    assert "| rays |" in listed.stdout
