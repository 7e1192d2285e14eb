"""Two workers of Ray Train train what one process does, also when one of them is killed."""

from pathlib import Path

import pytest
import torch

from bokehnet.config import load_config
from bokehnet.errors import ParameterError
from bokehnet.models.checkpoint import load_checkpoint
from tests.unit.train.run.test_distributed import curve, largest_difference, toy
from tests.unit.train.runs import finish_here
from tests.unit.train.toy_run import ToyRun, run
from train.run.ray_train import train_on_ray
from train.run.stopping import Stopped

ray = pytest.importorskip("ray", reason="needs the extra train-cluster")
pytest.importorskip("ray.train", reason="needs the extra train-cluster", exc_type=ImportError)

CPU = torch.device("cpu")


def config_of(folder: Path, **values) -> ToyRun:
    """Write the toy configuration and return it."""
    toy(folder / "any")
    settings = {key.replace("__", "."): value for key, value in values.items()}
    return load_config(folder / "toy.toml", ToyRun, settings)


@pytest.fixture(scope="module")
def two_workers(start_cluster):
    with start_cluster(2) as cluster:
        yield cluster


@pytest.mark.slow
@pytest.mark.train
def test_a_killed_worker_leaves_curve_and_weights_as_they_are(two_workers, tmp_path):
    """Authority: the same configuration in one process without an accident."""
    cluster = two_workers
    settings = {"optim__checkpoint_every": 2}
    finish_here(toy(tmp_path / "one", **settings))
    out, config = tmp_path / "two", config_of(tmp_path, kill_step=5, **settings)
    train_on_ray(run, config, out, CPU, 60, cluster.address)
    assert (out / "killed").exists()
    assert load_checkpoint(out / "last.pt")["step"] == 12
    for key in ("loss/sum", "gradient_norm"):
        torch.testing.assert_close(curve(tmp_path / "one", key), curve(out, key), rtol=2e-6, atol=0)
    assert largest_difference(tmp_path / "one", out) < 1e-6


@pytest.mark.slow
@pytest.mark.train
def test_the_time_limit_stops_the_workers_with_a_checkpoint(two_workers, tmp_path):
    with pytest.raises(Stopped, match="stopped at step 1 of 12; run the same command again"):
        train_on_ray(run, config_of(tmp_path), tmp_path / "run", CPU, 0, two_workers.address)


def test_an_address_without_a_cluster_is_refused(tmp_path):
    with pytest.raises(ParameterError, match="--ray: expected the address of a running cluster"):
        train_on_ray(run, config_of(tmp_path), tmp_path, CPU, 1, "127.0.0.1:1")
