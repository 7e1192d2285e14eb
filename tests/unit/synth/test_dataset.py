import dataclasses
import json
import os
import signal
import subprocess
import sys
import tarfile
import time
from pathlib import Path

import numpy as np
import pytest

from bokehnet.config import load_config, to_dict
from bokehnet.errors import ConfigError, DataFileError, ParameterError
from bokehnet.synth import SceneConfig, ShardSet, SynthConfig, read_sample, write_dataset
from bokehnet.synth.pairs import make_sample

TINY = "configs/synth_tiny.toml"


@pytest.fixture(scope="module")
def config():
    return load_config(TINY, SynthConfig)


@pytest.fixture(scope="module")
def whole(config, tmp_path_factory):
    folder = tmp_path_factory.mktemp("whole")
    write_dataset(config, folder)
    return folder


def contents(folder):
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def test_set_holds_every_scene_once_and_reads_at_random(config, whole):
    samples = ShardSet(whole)
    assert len(samples) == config.scenes
    expected = make_sample(config, 3)
    for result in (samples[3], read_sample(whole / "shard-000001.tar", "00000003")):
        for field in dataclasses.fields(result):
            assert np.array_equal(getattr(result, field.name), getattr(expected, field.name))
    with pytest.raises(IndexError):
        samples[config.scenes]
    assert json.loads((whole / "dataset.json").read_text()) == to_dict(config)
    with tarfile.open(whole / "shard-000000.tar") as archive:
        assert [(item.name, item.mtime) for item in archive] == [("00000000.npz", 0), ("00000001.npz", 0)]


def test_processes_give_the_bytes_of_one_process(config, whole, tmp_path):
    calls = []
    write_dataset(config, tmp_path, workers=2, progress=lambda done, total: calls.append((done, total)))
    assert contents(tmp_path) == contents(whole)
    assert calls == [(done, 4) for done in range(5)]


def second_has_begun(folder: Path) -> bool:
    return (folder / "shard-000000.tar").exists() and any(folder.glob(".bokehnet-*.tar"))


def test_killed_run_resumes_to_the_bytes_of_an_uninterrupted_one(config, whole, tmp_path):
    script = (
        "from bokehnet.config import load_config\nfrom bokehnet.synth import SynthConfig, write_dataset\n"
        "import sys, time\n"
        "def slow(done, total):\n    time.sleep(20 if done == 3 else 0)\n"
        f"write_dataset(load_config({TINY!r}, SynthConfig), sys.argv[1], progress=slow)\n"
    )
    process = subprocess.Popen([sys.executable, "-c", script, str(tmp_path)])
    deadline = time.monotonic() + 60
    while not second_has_begun(tmp_path) and time.monotonic() < deadline:
        time.sleep(0.02)
    os.kill(process.pid, signal.SIGKILL)
    process.wait()
    names = sorted(path.name for path in tmp_path.iterdir())
    assert names[0].startswith(".bokehnet-")
    assert names[1:] == ["dataset.json", "shard-000000.tar"]
    with pytest.raises(DataFileError, match="2 of 4 samples"):
        ShardSet(tmp_path)
    assert len(ShardSet(tmp_path, allow_incomplete=True)) == 2
    first = (tmp_path / "shard-000000.tar").stat().st_mtime_ns
    write_dataset(config, tmp_path)
    assert contents(tmp_path) == contents(whole)
    assert (tmp_path / "shard-000000.tar").stat().st_mtime_ns == first


def test_folder_of_another_configuration_is_refused_by_its_first_different_key(config, whole):
    other = dataclasses.replace(config, scene=dataclasses.replace(config.scene, tilt_limit=10.0))
    before = contents(whole)
    with pytest.raises(ConfigError, match=r"scene.tilt_limit = 65.0, but 10.0 was requested"):
        write_dataset(other, whole)
    assert contents(whole) == before


def test_set_that_was_begun_before_a_key_was_known_is_completed(config, whole, tmp_path):
    older = to_dict(config)
    for key in ("kind", "clutter", "catalog", "catalog_share"):
        del older[key]
    (tmp_path / "dataset.json").write_text(json.dumps(older))
    (tmp_path / "shard-000000.tar").write_bytes((whole / "shard-000000.tar").read_bytes())
    write_dataset(config, tmp_path)
    assert len(ShardSet(tmp_path)) == config.scenes
    with pytest.raises(ConfigError, match=r"kind = 'planes', but 'clutter' was requested"):
        write_dataset(dataclasses.replace(config, kind="clutter"), tmp_path)


def test_shards_are_what_webdataset_reads(config, whole):
    """Authority: the webdataset package, and its documented layout: members named key.extension."""
    webdataset = pytest.importorskip("webdataset", reason="webdataset is not installed")
    urls = [f"file:{path}" for path in sorted(whole.glob("*.tar"))]
    result = list(webdataset.WebDataset(urls, shardshuffle=False).decode())
    assert [sample["__key__"] for sample in result] == [f"{index:08d}" for index in range(config.scenes)]
    expected = ShardSet(whole)[2]
    for field in dataclasses.fields(expected):
        assert np.array_equal(result[2]["npz"][field.name], getattr(expected, field.name))


def test_unknown_key_names_the_file_the_key_and_the_valid_keys(tmp_path):
    path = tmp_path / "wrong.toml"
    path.write_text("seed = 1\nscenes = 2\n[scene]\ntilt = 3\n")
    with pytest.raises(ConfigError, match=r"wrong.toml: unknown key 'scene.tilt'; valid keys: .*tilt_limit"):
        load_config(path, SynthConfig)


def test_damaged_missing_and_unwritable_data_get_a_clear_error(config, whole, tmp_path):
    with pytest.raises(DataFileError, match="no sample 'x'; it has 00000000, 00000001"):
        read_sample(whole / "shard-000000.tar", "x")
    with pytest.raises(DataFileError, match="expected a shard"):
        read_sample(tmp_path / "none.tar", "x")
    with pytest.raises(DataFileError, match="description of a data set"):
        ShardSet(tmp_path)
    data = bytearray((whole / "shard-000000.tar").read_bytes())
    data[600:5000] = bytes(4400)
    (tmp_path / "bad.tar").write_bytes(data)
    with pytest.raises(DataFileError, match="sample 00000000: expected a training sample"):
        read_sample(tmp_path / "bad.tar", "00000000")
    (tmp_path / "file").write_text("")
    with pytest.raises(DataFileError, match="cannot write data set"):
        write_dataset(config, tmp_path / "file")
    with pytest.raises(ParameterError, match="workers"):
        write_dataset(config, tmp_path / "new", workers=0)


def test_shards_are_read_without_torch(whole):
    script = (
        "import sys\nsys.modules['torch'] = None\nfrom bokehnet.synth import ShardSet\n"
        "print(ShardSet(sys.argv[1])[1].image.shape)\n"
    )
    shown = subprocess.run(
        [sys.executable, "-c", script, str(whole)], capture_output=True, text=True, check=True
    )
    assert shown.stdout.strip() == "(64, 64, 3)"


def test_a_set_without_torch_writes_nothing(tmp_path):
    script = (
        "import sys\nsys.modules['torch'] = None\nfrom bokehnet.config import load_config\n"
        "from bokehnet.errors import MissingExtraError\n"
        "from bokehnet.synth import SynthConfig, write_dataset\n"
        "try:\n    write_dataset(load_config(sys.argv[1], SynthConfig), sys.argv[2])\n"
        "except MissingExtraError as error:\n    print(error)\n"
    )
    words = [sys.executable, "-c", script, TINY, str(tmp_path / "set")]
    shown = subprocess.run(words, capture_output=True, text=True, check=True)
    assert "bokehnet[train]" in shown.stdout
    assert not (tmp_path / "set").exists()


def test_one_process_renders_on_one_thread_and_gives_the_others_back(config, tmp_path):
    import torch

    before, seen = torch.get_num_threads(), []
    write_dataset(config, tmp_path, progress=lambda *_: seen.append(torch.get_num_threads()))
    assert set(seen) == {1}
    assert torch.get_num_threads() == before


def test_a_folder_beside_names_of_photographs_is_refused():
    with pytest.raises(ParameterError, match="photograph_folder: expected a folder or names"):
        SceneConfig(photographs=("astronaut",), photograph_folder="mine")
