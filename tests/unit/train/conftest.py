import pytest

from bokehnet.config import load_config
from bokehnet.synth import SynthConfig, write_dataset
from tests.unit.train.runs import ROOT


@pytest.fixture(scope="session")
def tiny_pairs(tmp_path_factory):
    """Four traced scenes of 64x64 pixels."""
    folder = tmp_path_factory.mktemp("pairs")
    write_dataset(load_config(ROOT / "configs/synth_tiny.toml", SynthConfig), folder)
    return folder
