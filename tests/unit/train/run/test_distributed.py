"""Two processes train what one does, stop together, and share the work."""

import sys
from pathlib import Path

import pytest
import torch
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator
from torch.utils.data import DataLoader

from bokehnet.errors import ConfigError, ParameterError
from bokehnet.models.checkpoint import load_checkpoint
from tests.unit.train.run.test_resume import wait_for
from tests.unit.train.runs import ROOT, arguments, finish, finish_here, start
from tests.unit.train.toy_run import Pairs
from train.recipe_steps.jobs import call
from train.run.distributed import Processes, joined

CPU = torch.device("cpu")
TORCHRUN = [sys.executable, "-m", "torch.distributed.run", "--standalone", "--nproc-per-node", "2"]


def toy(out: Path, **values) -> list[str]:
    """Command line of a toy run on one process; two underscores stand for the dot of a key."""
    config = out.parent / "toy.toml"
    config.write_text("[optim]\nsteps = 12\nwarmup = 0\nlog_every = 1\nbfloat16 = false\n")
    line = [sys.executable, "-m", "tests.unit.train.toy_run", "--config", str(config), "--out", str(out)]
    line += ["--device", "cpu"]
    sets = [f"{key.replace('__', '.')}={value}" for key, value in values.items()]
    return line + [part for item in sets for part in ("--set", item)]


def twice(line: list[str]) -> list[str]:
    """The same run on two processes."""
    return TORCHRUN + line[1:]


def curve(out: Path, key: str) -> torch.Tensor:
    events = EventAccumulator(str(out))
    events.Reload()
    return torch.tensor([point.value for point in events.Scalars(key)], dtype=torch.float64)


def largest_difference(first: Path, second: Path) -> float:
    one, two = load_checkpoint(first / "last.pt"), load_checkpoint(second / "last.pt")
    assert one["step"] == two["step"]
    return max(
        float((weights - two[part][key]).abs().max())
        for part in ("network", "raw")
        for key, weights in one[part].items()
    )


def test_each_process_loads_only_its_part_of_every_batch():
    requested = []

    class Noted(Pairs):
        def __getitem__(self, index):
            requested.append(index)
            return super().__getitem__(index)

    whole = DataLoader(Noted(), batch_size=6, sampler=range(12, 30))
    parts = [list(Processes(rank, 3).share(whole, CPU)) for rank in range(3)]
    assert sorted(requested) == list(range(12, 30))
    for number, batch in enumerate(whole):
        shares = [parts[rank][number]["x"] for rank in range(3)]
        assert [len(share) for share in shares] == [2, 2, 2]
        assert torch.equal(torch.cat(shares), batch["x"])


def test_a_batch_without_equal_parts_is_refused():
    Processes(0, 3).check_batch(6)
    with pytest.raises(ConfigError, match=r"batch_size = 8 .* expected a multiple .* found 3 processes"):
        Processes(0, 3).check_batch(8)


def test_a_numbered_gpu_is_refused_behind_torchrun(monkeypatch):
    monkeypatch.setattr("torch.distributed.is_torchelastic_launched", lambda: True)
    monkeypatch.setattr("torch.cuda.device_count", lambda: 2)
    monkeypatch.setenv("LOCAL_RANK", "1")
    numbered = pytest.raises(ParameterError, match="use --device cuda and --nproc-per-node 2")
    with numbered, joined(torch.device("cuda:0")):
        pass
    monkeypatch.setenv("LOCAL_RANK", "2")
    too_many = pytest.raises(ParameterError, match="got cuda in process 2")
    with too_many, joined(torch.device("cuda")):
        pass


@pytest.fixture(scope="module")
def whole(tmp_path_factory) -> Path:
    """Folder of a toy run on one process."""
    out = tmp_path_factory.mktemp("toy") / "one"
    finish_here(toy(out))
    return out


@pytest.mark.train
def test_two_processes_have_the_curve_and_the_weights_of_one(whole, tmp_path):
    """A mean over examples has the same gradient in parts; found 5e-7 apart near 5, weights 1.5e-8."""
    finish(twice(toy(tmp_path / "two")))
    for key in ("loss/sum", "loss/square", "gradient_norm"):
        one, two = curve(whole, key), curve(tmp_path / "two", key)
        assert len(one) == 12
        torch.testing.assert_close(one, two, rtol=2e-6, atol=0)
    assert largest_difference(whole, tmp_path / "two") < 1e-6


@pytest.mark.train
def test_a_kill_of_one_process_stops_both_and_the_run_goes_on_with_one(whole, tmp_path):
    """Process 1 alone is to stop in step 5; process 0 writes the checkpoint, later alone the rest."""
    line = toy(tmp_path / "cut", stop_step=5)
    process = start(twice(line))
    _, errors = process.communicate(timeout=120)
    assert process.returncode != 0
    assert errors.count("stopped at step 6 of 12; run the same command again to resume") == 1
    assert load_checkpoint(tmp_path / "cut/last.pt")["step"] == 6
    finish_here(line)
    assert largest_difference(whole, tmp_path / "cut") < 2e-6


@pytest.mark.train
def test_the_time_limit_stops_both_without_an_error(tmp_path):
    line = [*toy(tmp_path / "run"), "--max-minutes", "0"]
    assert "stopped at step 1 of 12" in finish(twice(line))
    assert "stopped at step 2 of 12" in finish_here(line)


@pytest.mark.train
def test_a_polite_kill_of_torchrun_leaves_a_checkpoint(tmp_path):
    """``torchrun`` passes the signal to all processes of each group, loaders too."""
    out = tmp_path / "run"
    process = start(
        twice(
            toy(out, data__workers=1, optim__steps=100000, optim__checkpoint_every=20, optim__log_every=1000)
        )
    )
    wait_for(out / "last.pt")
    process.terminate()
    _, errors = process.communicate(timeout=60)
    step = load_checkpoint(out / "last.pt")["step"]
    assert f"stopped at step {step} of 100000" in errors


@pytest.mark.train
def test_a_mistake_ends_both_with_its_line(tmp_path):
    process = start(twice(toy(tmp_path / "run", data__batch_size=3)))
    _, errors = process.communicate(timeout=120)
    assert process.returncode != 0
    assert "error: data.batch_size = 3 is shared by all processes" in errors


@pytest.mark.train
def test_arnet_trains_on_two_processes_as_on_one(tiny_prepared, tmp_path, monkeypatch):
    """The real thing, as a recipe calls it; its loss is a mean over the examples too."""
    monkeypatch.chdir(ROOT)
    values = {"data.batch_size": 4, "optim.log_every": 1}
    line = arguments("arnet", tiny_prepared, tmp_path / "one", 8, **values)
    finish_here(line)
    call(["python", *arguments("arnet", tiny_prepared, tmp_path / "two", 8, **values)[1:]], processes=2)
    one, two = curve(tmp_path / "one", "loss/sum"), curve(tmp_path / "two", "loss/sum")
    assert len(one) == len(two) == 8
    apart = (two / one - 1).abs()
    assert apart.max() < 1e-5
