"""The loop as a whole, on a network that takes no time."""

import dataclasses
import math

import pytest
import torch
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

from bokehnet.errors import ConfigError, ParameterError
from bokehnet.models.checkpoint import load_checkpoint
from tests.unit.train.toy_run import ToyData, ToyModel, ToyRun, run
from train.run.loop import OptimConfig, Stopped
from train.run.run_folder import RunFolder

CPU = torch.device("cpu")


def config_of(steps: int, **values) -> ToyRun:
    settings = {"warmup": 0, "log_every": 1, "checkpoint_every": 10**6, "validate_every": 10**6}
    optim = {key: values.pop(key) for key in list(values) if key in OptimConfig.__dataclass_fields__}
    return ToyRun(optim=OptimConfig(steps=steps, bfloat16=False, **{**settings, **optim}), **values)


def start(config, out, max_minutes=math.inf):
    return load_checkpoint(run(config, out, CPU, max_minutes))


def curve(out, key="loss/sum"):
    events = EventAccumulator(str(out))
    events.Reload()
    return [(point.step, point.value) for point in events.Scalars(key)]


def assert_same(first, second):
    for part in ("network", "raw"):
        for key, weights in first[part].items():
            assert torch.equal(weights, second[part][key]), f"{part} {key}"


def test_a_run_cut_into_slices_ends_where_a_whole_one_ends(tmp_path):
    """Stops of all kinds: no time left, then a kill; with dropout, whose lots follow from the step."""
    config = config_of(12, model=ToyModel(dropout=0.3), stop_step=6, stop_rank=0)
    with pytest.raises(Stopped, match="stopped at step 1 of 12") as late:
        start(config, tmp_path / "cut", max_minutes=0)
    assert not late.value.interrupted
    with pytest.raises(Stopped, match="stopped at step 7 of 12") as error:
        start(config, tmp_path / "cut")
    assert error.value.interrupted
    cut = start(config, tmp_path / "cut")
    whole = start(config_of(12, model=ToyModel(dropout=0.3)), tmp_path / "whole")
    assert cut["step"] == whole["step"] == 12
    assert_same(cut, whole)
    assert curve(tmp_path / "cut") == curve(tmp_path / "whole")
    assert len(curve(tmp_path / "whole")) == 12
    assert [step for step, _ in curve(tmp_path / "whole", "validation/bias")] == [12]


def test_the_loss_falls(tmp_path):
    start(config_of(60, learning_rate=0.02), tmp_path)
    values = [value for _, value in curve(tmp_path)]
    assert sum(values[-10:]) < 0.1 * sum(values[:10])


def test_steps_without_finite_gradient_are_reported_and_counted(tmp_path, capsys):
    start(config_of(6, bad_from=2, bad_to=4), tmp_path)
    assert "step 4: gradient not finite, step skipped (2 since the start)" in capsys.readouterr().out
    assert [count for _, count in curve(tmp_path, "skipped_steps")] == [0, 0, 1, 2, 2, 2]


def test_a_run_that_diverged_stops_with_its_last_checkpoint(tmp_path):
    config = config_of(100, bad_from=3, bad_to=100, checkpoint_every=2)
    with pytest.raises(ParameterError, match=r"expected a finite gradient, got none in 25 steps in a row"):
        start(config, tmp_path)
    assert load_checkpoint(tmp_path / "last.pt")["step"] == 26


def test_a_checkpoint_is_due_after_steps_or_minutes(tmp_path, monkeypatch):
    clock = [1000.0]
    monkeypatch.setattr("time.monotonic", lambda: clock[0])
    folder = RunFolder(tmp_path, "arnet", config_of(100, checkpoint_every=10, checkpoint_minutes=3.0))
    folder.prepare()
    assert [step for step in range(1, 101) if folder.due(step)] == list(range(10, 101, 10))
    clock[0] += 179
    assert not folder.due(11)
    clock[0] += 2
    assert folder.due(11)
    folder.save({"network": {}, "step": 11})
    assert not folder.due(12)


def test_a_run_from_before_a_setting_existed_goes_on_with_its_default(tmp_path):
    config = config_of(4)
    state = start(config, tmp_path)
    del state["run"]["optim"]["checkpoint_minutes"]
    torch.save(state, tmp_path / "last.pt")
    assert start(config, tmp_path)["step"] == 4
    other = dataclasses.replace(config, optim=dataclasses.replace(config.optim, checkpoint_minutes=1.0))
    with pytest.raises(ConfigError, match=r"optim.checkpoint_minutes = 3.0, but 1.0 was requested"):
        start(other, tmp_path)


def test_loader_processes_outlive_signals_to_the_whole_group(tmp_path):
    """Ctrl-C and ``torchrun`` signal every process of a group; who trains still needs its batches to save."""
    assert start(config_of(40, data=ToyData(workers=1), shaken_step=5), tmp_path)["step"] == 40
