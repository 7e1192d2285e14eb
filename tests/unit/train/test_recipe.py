"""One command from nothing: its plan hangs together, and it goes on where it was killed."""

import json
import re
import shlex
import signal
import subprocess
import sys
import time
import tomllib
from pathlib import Path
from types import SimpleNamespace

import pytest

from bokehnet.config import build_config
from bokehnet.errors import ConfigError, ParameterError
from tests.unit.train.runs import ROOT, arguments
from train.recipe import _processes, main
from train.recipe_steps.jobs import call
from train.recipe_steps.plan import Recipe, load_recipe
from train.recipe_steps.progress import Progress
from train.recipe_steps.queue import Queue, expected_seconds

FULL, SMOKE, SMALL = (ROOT / f"configs/{name}.toml" for name in ("recipe", "recipe_smoke", "recipe_small"))


@pytest.fixture(autouse=True)
def _in_the_repository(monkeypatch):
    """Recipes name configurations from there."""
    monkeypatch.chdir(ROOT)


def recipe_of(*steps: dict) -> Recipe:
    recipe = build_config({"steps": list(steps)}, Recipe)
    recipe.check()
    return recipe


PLANES = {"makes": "data/planes", "by": "synth", "config": "configs/synth_planes.toml", "seconds": 3.0}
PLANES_VAL = {"makes": "data/planes_val", "by": "synth", "config": "configs/synth_planes_val.toml"}
RAYS = {"makes": "data/rays", "by": "prepare", "config": "configs/prepare_rays.toml", "seconds": 1.0}
RAYS_VAL = {"makes": "data/rays_val", "by": "prepare", "config": "configs/prepare_rays_val.toml"}
SETS = PLANES, PLANES_VAL, RAYS, RAYS_VAL
ARNET = {"makes": "runs/arnet", "by": "arnet", "config": "configs/train_arnet.toml", "seconds": 0.5}
EXPORT = {"makes": "bokehnet/weights/hybrid", "by": "export", "words": ["--arnet", "runs/arnet/last.pt"]}


def test_all_networks_are_made_within_twelve_hours_on_two_cores():
    recipe = load_recipe(FULL)
    assert recipe.workers == 2
    assert expected_seconds(recipe, recipe.steps) < 12 * 3600
    results = {step.makes for step in recipe.steps if step.by == "export"}
    assert results == {f"bokehnet/weights/{name}" for name in ("hybrid", "error", "neural")}


def test_the_smoke_recipe_has_the_steps_of_the_full_one_in_their_order():
    full, smoke = load_recipe(FULL), load_recipe(SMOKE)
    assert [(step.makes, step.by) for step in smoke.steps] == [(step.makes, step.by) for step in full.steps]


def test_a_run_that_no_step_makes_is_named():
    """Inputs of a chain of trainings must be outputs of earlier steps, unlike ``runs/arnet2`` here."""
    fine = {**ARNET, "makes": "runs/fine", "settings": ['start="runs/arnet2/last.pt"']}
    with pytest.raises(
        ConfigError, match=r"start names runs/arnet2/last\.pt, which no step before runs/fine makes"
    ):
        recipe_of(*SETS, ARNET, fine)
    with pytest.raises(ConfigError, match=r"data\.folder names data/rays, which no step"):
        recipe_of(ARNET, *SETS)
    scores = {"makes": "runs/scores.json", "by": "evaluate", "words": ["hybrid:bokehnet/weights/hybrid"]}
    with pytest.raises(ConfigError, match="words names hybrid:bokehnet/weights/hybrid, which no step before"):
        recipe_of(*SETS, scores, ARNET, EXPORT)
    recipe_of(PLANES, scores)  # with the network that ships
    with pytest.raises(ConfigError, match="two steps that make data/planes"):
        recipe_of(PLANES, PLANES)
    with pytest.raises(ConfigError, match="data/x: words names runs/none/last"):
        recipe_of({"makes": "data/x", "by": "export", "words": ["--arnet", "runs/none/last.pt"]})


def test_times_follow_from_what_the_configurations_ask_for():
    """Authority: by hand; 1200 scenes of 3 s and of 1 s on two cores, 4500 steps of half a second."""
    recipe = recipe_of(*SETS, ARNET)
    assert [recipe.seconds(step) for step in recipe.steps] == [1800, 0, 600, 0, 2250]
    short = recipe_of(*SETS, {**ARNET, "settings": ["optim.steps=10"]})
    assert short.seconds(short.steps[4]) == 5


def test_steps_side_by_side_wait_for_what_they_need_and_for_a_core():
    """Authority: by hand; sets on both cores for 2400 s, then 2250 s of a training beside 500 and 1000."""
    other = {**ARNET, "makes": "runs/other", "settings": ["optim.steps=1000"]}
    settings = ["optim.steps=2000", 'start="runs/other/last.pt"']
    recipe = recipe_of(*SETS, ARNET, other, {**ARNET, "makes": "runs/b", "settings": settings})
    assert expected_seconds(recipe, recipe.steps) == 4650
    assert expected_seconds(recipe, recipe.steps[5:]) == 1500
    *sets, arnet, before, behind = recipe.steps
    queue = Queue(recipe, recipe.steps, 2)
    for data in sets:
        assert queue.take() == (data, 2)
        assert queue.take() is None
        queue.give_back(data, 2)
    assert [queue.take() for _ in range(3)] == [(arnet, 1), (before, 1), None]
    queue.give_back(arnet, 1)
    assert queue.take() is None
    queue.give_back(before, 1)
    assert [queue.take(), queue.take()] == [(behind, 1), None]


def test_commands_name_what_configurations_name_or_all_below_one_folder():
    recipe = recipe_of(*SETS, {**ARNET, "settings": ["optim.steps=10"]}, EXPORT)
    plain, rooted = (recipe.command(recipe.steps[4], root) for root in (None, Path("out")))
    start = "python -m train.train_arnet --config configs/train_arnet.toml"
    assert shlex.join(plain) == f"{start} --out runs/arnet --set optim.steps=10"
    assert set(rooted) - set(plain) == {
        "out/runs/arnet",
        'data.folder="out/data/rays"',
        'data.validation="out/data/rays_val"',
    }
    assert recipe.command(recipe.steps[5], Path("out"))[3:] == [
        "--arnet",
        "out/runs/arnet/last.pt",
        "--out",
        "out/weights/hybrid",
    ]
    assert recipe.command(recipe.steps[0], Path("out"), ray="host:6379")[-2:] == ["--ray", "host:6379"]


def test_a_share_lessens_scenes_and_steps_and_leaves_what_they_are_made_into():
    """Authority: by hand; a hundredth of 1200 scenes and of 4500 steps, and of a warm-up of 200."""
    recipe = recipe_of(*SETS, ARNET, EXPORT)
    less = recipe.with_share(0.01)
    assert [less.units(step) for step in less.steps] == [12, 1, 12, 1, 45, 1]
    assert less.command(less.steps[0])[-2:] == ["--set", "scenes=12"]
    assert less.command(less.steps[4])[-4:] == ["--set", "optim.steps=45", "--set", "optim.warmup=2"]
    assert less.steps[5] == recipe.steps[5]
    assert recipe.with_share(1).seconds(recipe.steps[4]) == recipe.seconds(recipe.steps[4])
    for share in (0, -1, 1.5, float("nan")):
        with pytest.raises(ParameterError, match="--share: expected above 0 and at most 1"):
            recipe.with_share(share)


def test_a_seed_applies_to_all_trainings_and_restarts_them():
    recipe = recipe_of(*SETS, ARNET)
    other = recipe.with_seed(5)
    assert other.command(other.steps[4])[-2:] == ["--set", "optim.seed=5"]
    changed = [
        recipe.fingerprint(a) != other.fingerprint(b) for a, b in zip(recipe.steps, other.steps, strict=True)
    ]
    assert changed == [False] * 4 + [True]


@pytest.mark.parametrize(
    ("devices", "batch", "count"), [(0, 8, 1), (1, 8, 1), (2, 8, 2), (3, 8, 2), (8, 4, 4)]
)
def test_as_many_devices_share_a_training_as_divide_its_batch(devices, batch, count, monkeypatch):
    monkeypatch.setattr("torch.cuda.device_count", lambda: devices)
    assert _processes({"data": {"batch_size": batch}}) == count


@pytest.mark.train
def test_a_training_of_two_processes_that_fails_is_named(tmp_path):
    """One that succeeds is in ``run/test_distributed.py``."""
    with pytest.raises(SystemExit, match=r"train\.train_arnet failed; see its messages"):
        call(["python", *arguments("arnet", tmp_path / "none", tmp_path / "other", 3)[1:]], processes=2)


def finished(progress: Progress, *numbers: int) -> None:
    for number in numbers:
        step = progress.recipe.steps[number]
        path = progress.out / step.makes.removeprefix("bokehnet/")
        path.parent.mkdir(parents=True, exist_ok=True)
        path.mkdir(exist_ok=True)
        progress.begin(step)
        progress.end(step, done=True)


def test_a_step_is_done_if_it_and_its_inputs_match_the_request(tmp_path):
    recipe = recipe_of(*SETS, ARNET, EXPORT)
    finished(Progress(recipe, tmp_path), *range(6))
    assert all(map(Progress(recipe, tmp_path).done, recipe.steps))
    longer = recipe_of(*SETS, {**ARNET, "settings": ["optim.steps=9000"]}, EXPORT)
    assert [Progress(longer, tmp_path).done(step) for step in longer.steps] == [True] * 4 + [False] * 2
    (tmp_path / "data/planes_val").rmdir()
    assert [Progress(recipe, tmp_path).done(step) for step in recipe.steps] == [True, False] + [True] * 4


def test_a_training_with_changed_settings_is_not_resumed(tmp_path):
    """Its own configuration is the same; an export would be repeated."""
    fine = {**ARNET, "makes": "runs/fine", "settings": ['start="runs/arnet/last.pt"']}
    recipe = recipe_of(*SETS, ARNET, fine, EXPORT)
    finished(Progress(recipe, tmp_path), *range(7))
    longer = recipe_of(*SETS, {**ARNET, "settings": ["optim.steps=9000"]}, fine, EXPORT)
    progress = Progress(longer, tmp_path)
    for number in (0, 1, 2, 3, 4, 6):
        progress.check(longer.steps[number])
    with pytest.raises(ConfigError, match=r"runs/fine: was made from outputs of earlier steps.*remove it"):
        progress.check(longer.steps[5])
    (tmp_path / "runs/fine").rmdir()
    progress.check(longer.steps[5])


def test_a_step_that_fails_or_is_killed_is_begun_and_its_time_counts(tmp_path):
    recipe = recipe_of(PLANES, PLANES_VAL)
    failing, killed = recipe.steps
    clock = SimpleNamespace(now=0.0)
    for _ in range(2):
        progress = Progress(recipe, tmp_path, lambda: clock.now)
        progress.begin(killed)
        clock.now += 5
        progress.begin(failing)
        clock.now += 40
        progress.end(failing, done=False)
        clock.now += 60
        progress.save_periodically()
        clock.now += 10  # what nobody has noted before the kill
    progress = Progress(recipe, tmp_path)
    assert progress.state(failing) == "begun, 80 s so far"
    assert progress.seconds(killed) == 210
    assert progress.elapsed == 210


def test_a_dry_run_prints_the_plan_and_makes_nothing(tmp_path, capsys):
    main(["--dry-run", "--out", str(tmp_path / "out")])
    message = capsys.readouterr().out
    assert re.search(r"^runs/arnet_wide +arnet +\d+\.\d min +to do$", message, re.MULTILINE)
    assert re.search(r"^expected: \d+\.\d h in all \(cores: 2\), ", message.splitlines()[-1])
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("steps = 3", "steps: expected"),
        ('[[steps]]\nmakes = "x"\nby = "magic"', "by: expected"),
        ('[[steps]]\nmakes = "data/x"\nby = "synth"\nconfig = "nowhere.toml"', "cannot read nowhere.toml"),
        ('[[steps]]\nmakes = "data/x"\nby = "synth"\nconfig = "configs/train_arnet.toml"', "names|lacks"),
    ],
)
def test_mistakes_in_a_recipe_are_one_line(text, message, tmp_path):
    path = tmp_path / "mine.toml"
    path.write_text(text)
    with pytest.raises(SystemExit) as caught:
        main(["--config", str(path), "--out", str(tmp_path / "out")])
    assert re.match(f"error: .*{message}", str(caught.value.code))
    assert "\n" not in str(caught.value.code)


def test_a_folder_of_something_else_is_refused(tmp_path):
    for text in ("[]", '{"steps": []}', '{"steps": {"a": 3}}', "{"):
        (tmp_path / "recipe.json").write_text(text)
        with pytest.raises(SystemExit) as caught:
            main(["--small", "--out", str(tmp_path)])
        assert "recipe.json: expected the progress of a recipe" in str(caught.value.code)


def test_commands_of_the_documentation_are_steps_of_the_recipe():
    """Each configuration on the page is one of a step, so that the page cannot drift from the recipe."""
    recipe = load_recipe(FULL)
    steps = [" ".join(recipe.command(step)) for step in recipe.steps]
    text = (ROOT / "docs/develop/training.md").read_text(encoding="utf-8")
    single = text[text.index("## The single commands") : text.index("`tensorboard")]
    configurations = re.findall(r"--config (\S+)", single)
    assert len(configurations) >= 3
    assert all(any(name in step for step in steps) for name in configurations)


@pytest.mark.slow
@pytest.mark.train
@pytest.mark.timeout(900)
def test_the_small_recipe_learns(tmp_path):
    """Validation and test scenes: better than the classical picture, which is doing nothing."""
    # Another test runs on the other core.
    text = SMALL.read_text(encoding="utf-8").replace("threads = 2", "threads = 1")
    (tmp_path / "small.toml").write_text(text)
    words = ["--config", str(tmp_path / "small.toml"), "--out", str(tmp_path)]
    line = [sys.executable, "-m", "train.recipe", *words]
    done = subprocess.run(line, cwd=ROOT, capture_output=True, text=True, timeout=900)
    assert done.returncode == 0, done.stderr
    log = "".join(path.read_text() for path in (tmp_path / "logs").glob("*arnet*"))
    gains = [float(gain) for gain in re.findall(r"gain/edge_psnr (-?[0-9.]+)", log)]
    assert len(gains) >= 3
    assert min(gains) > 0.1
    assert gains[-1] > 0.2
    assert (tmp_path / "runs/scores_test.json").exists()


def test_the_test_scenes_of_the_small_recipe_share_nothing_with_its_other_scenes():
    sets = [
        tomllib.loads((ROOT / f"configs/synth_small{suffix}.toml").read_text())
        for suffix in ("", "_val", "_test")
    ]
    photographs = [name for one in sets for name in one["scene"]["photographs"]]
    assert len(set(photographs)) == len(photographs)
    assert len({one["seed"] for one in sets}) == 3


@pytest.mark.slow
@pytest.mark.train
def test_the_smoke_recipe_runs_to_its_end_after_a_kill_and_nothing_is_done_twice(tmp_path, capfd):
    """All steps on a few small scenes: killed in a training, gone on with, and asked for once more."""
    line = [sys.executable, "-m", "train.recipe", "--config", str(SMOKE), "--out", str(tmp_path)]
    killed = subprocess.Popen(line, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
    deadline = time.monotonic() + 400
    while not (tmp_path / "runs/arnet/last.pt").exists():
        assert killed.poll() is None
        assert time.monotonic() < deadline
        time.sleep(0.05)
    killed.send_signal(signal.SIGKILL)
    first, _ = killed.communicate()
    before = (tmp_path / "data/rays/prepared.json").stat().st_mtime_ns
    done = subprocess.run(line, cwd=ROOT, capture_output=True, text=True, timeout=500)
    assert done.returncode == 0, done.stderr
    begun = [re.findall(r"^\[(\d+)/", text, re.MULTILINE) for text in (first, done.stdout)]
    count = len(load_recipe(SMOKE).steps)
    assert [int(number) for number in begun[0][:-1]] == list(range(1, len(begun[0])))
    assert int(begun[1][0]) in (len(begun[0]), len(begun[0]) + 1)
    assert int(begun[1][-1]) == count
    assert (tmp_path / "data/rays/prepared.json").stat().st_mtime_ns == before
    for name in ("hybrid", "error", "neural"):
        manifest = json.loads((tmp_path / "weights" / name / "manifest.json").read_text())
        assert str(tmp_path) in json.dumps(manifest["notes"])
    card = (tmp_path / "runs/model_card.md").read_text()
    assert "| neural/ | iunet |" in card
    assert "| rays | clean |" in card
    capfd.readouterr()
    main(line[3:])
    assert "[" not in capfd.readouterr().out
