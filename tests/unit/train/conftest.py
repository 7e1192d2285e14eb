import pytest

from bokehnet.config import load_config
from bokehnet.synth import SynthConfig, write_dataset
from tests.unit.train.runs import ROOT


@pytest.fixture(scope="session")
def tiny_pairs(tmp_path_factory):
    """Four traced scenes of 64x64 pixels, two views each."""
    folder = tmp_path_factory.mktemp("pairs")
    write_dataset(load_config(ROOT / "configs/synth_tiny.toml", SynthConfig), folder)
    return folder


@pytest.fixture(scope="session")
def tiny_prepared(tiny_pairs, tmp_path_factory):
    """Their renders with true and with augmented disparity."""
    from train.prepare import PrepareConfig, prepare

    folder = tmp_path_factory.mktemp("prepared")
    prepare(PrepareConfig(folder=str(tiny_pairs), scenes_per_part=2), folder)
    return folder
