"""Log of a run."""

import sys
from types import SimpleNamespace

import pytest
import torch

from bokehnet.errors import MissingExtraError
from train.run.logbook import Logbook, over_held_out


def test_validation_reports_progress(capsys):
    assert list(over_held_out(["a", "b", "c"])) == ["a", "b", "c"]
    message = capsys.readouterr().err
    assert "validating" in message
    assert "0/3" in message


class _Run:
    """Records what a run of Weights & Biases receives."""

    def __init__(self):
        self.rows, self.exit_code = [], None

    def log(self, values, step):
        self.rows.append((step, values))

    def finish(self, exit_code):
        self.exit_code = exit_code


def test_curves_scores_and_pictures_go_to_weights_and_biases(tmp_path, monkeypatch):
    """Authority: the interface of wandb: init, log with a step, Image, finish."""
    run, started = _Run(), []
    module = SimpleNamespace(
        init=lambda **words: started.append(words) or run, Image=lambda array: array.shape
    )
    monkeypatch.setitem(sys.modules, "wandb", module)
    monkeypatch.setenv("WANDB_PROJECT", "bokeh")
    with Logbook("arnet", tmp_path, steps=9, first_step=3, silent=False) as logbook:
        logbook.curves({"loss/sum": 0.5}, 4)
        logbook.validation({"psnr": 30.0}, {"example": torch.zeros(3, 4, 6)}, 5)
    assert started[0]["resume"] == "allow"
    assert run.rows == [(4, {"loss/sum": 0.5}), (5, {"validation/psnr": 30.0, "example": (4, 6, 3)})]
    assert run.exit_code == 0


def test_weights_and_biases_receive_nothing_unasked(tmp_path, monkeypatch):
    monkeypatch.delenv("WANDB_PROJECT", raising=False)
    monkeypatch.setitem(sys.modules, "wandb", None)
    with Logbook("arnet", tmp_path, steps=9, first_step=0, silent=False) as logbook:
        logbook.curves({"loss/sum": 0.5}, 1)


def test_a_missing_package_is_one_line(tmp_path, monkeypatch):
    monkeypatch.setenv("WANDB_PROJECT", "bokeh")
    monkeypatch.setitem(sys.modules, "wandb", None)
    with pytest.raises(
        MissingExtraError, match="WANDB_PROJECT: expected the package wandb; pip install wandb"
    ):
        Logbook("arnet", tmp_path, steps=9, first_step=0, silent=False)
