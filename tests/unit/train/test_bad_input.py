"""Damaged data is reported in one line: shards and parts are left out with a count, the rest ends the run."""

import json
import re
import shutil
from dataclasses import dataclass

import numpy as np
import pytest
import torch

from bokehnet.errors import ConfigError, DataFileError, ModelFileError
from bokehnet.inference.session import load_network as load_onnx
from bokehnet.models.arnet import ARNet, ARNetConfig
from bokehnet.models.checkpoint import load_checkpoint, load_network, load_weights, save_checkpoint
from bokehnet.models.onnx_export import export_networks
from bokehnet.synth.shards import ShardSet, decode_sample, encode_sample
from tests.unit.train.run.test_loop import config_of, start
from train.data.crops import DataConfig, PreparedCrops
from train.data.prepared import PreparedSet, part_name
from train.prepare import PrepareConfig, prepare
from train.run.run_folder import RunFolder

SMALL = ARNetConfig(width=8, num_blocks=1)


def warnings(capsys) -> list[str]:
    return [line for line in capsys.readouterr().err.splitlines() if line.startswith("warning: ")]


@pytest.fixture
def pairs(tiny_pairs, tmp_path):
    """A copy of four scenes in two shards, to be broken."""
    return shutil.copytree(tiny_pairs, tmp_path / "pairs")


def break_shard(pairs) -> None:
    shard = pairs / "shard-000000.tar"
    shard.write_bytes(shard.read_bytes()[:-20000])


def break_sample(pairs, number: int) -> None:
    """One byte of the picture of a sample of the second shard."""
    path, _, offset, size = ShardSet(pairs)._members[number]
    data = bytearray(path.read_bytes())
    data[offset + size // 2] ^= 1
    path.write_bytes(data)


def test_a_broken_shard_and_a_broken_scene_are_named_counted_and_skipped(pairs, tmp_path, capsys):
    break_sample(pairs, 3)
    break_shard(pairs)
    prepare(PrepareConfig(folder=str(pairs), classical="scatter", augmented=0), tmp_path / "prepared")
    message = warnings(capsys)
    assert len(message) == 2
    assert "shard-000000.tar" in message[0]
    assert message[0].endswith("skipped, 1 so far")
    assert "shard-000001.tar, sample 00000003: expected a training sample" in message[1]
    assert message[1].endswith("skipped, 2 so far")
    assert len(PreparedSet(tmp_path / "prepared")) == 2


def test_a_missing_shard_is_no_broken_one(pairs):
    (pairs / "shard-000000.tar").unlink()
    with pytest.raises(DataFileError, match="found 2 of 4 samples; run bokehnet synth again"):
        ShardSet(pairs)


def test_a_scene_whose_arrays_do_not_belong_together_is_damaged(tiny_pairs):
    import dataclasses

    sample = dataclasses.replace(ShardSet(tiny_pairs)[0], focus=np.zeros(3, np.float32))
    with pytest.raises(DataFileError, match=r"here: expected a training sample.*focus of shape \(3,\)"):
        decode_sample(encode_sample(sample), "here")


def test_preparing_leaves_broken_scenes_out_and_goes_on(pairs, tiny_prepared, tmp_path, capsys):
    """The others are what they are without them."""
    break_sample(pairs, 2)
    config = PrepareConfig(folder=str(pairs), scenes_per_part=1)
    prepare(config, tmp_path / "prepared")
    (message,) = warnings(capsys)
    assert "sample 00000002" in message
    whole, rest = PreparedSet(tiny_prepared), PreparedSet(tmp_path / "prepared")
    assert len(whole) - len(rest) == 4
    np.testing.assert_array_equal(rest[8], whole[12])


def test_a_damaged_part_is_skipped_and_one_of_another_version_is_refused(tiny_prepared, tmp_path, capsys):
    folder = shutil.copytree(tiny_prepared, tmp_path / "prepared")
    part = folder / part_name(0)
    whole = part.read_bytes()
    config = DataConfig(folder=str(folder), validation="", coarse_crop=32, fine_crop=32)
    part.write_bytes(whole[:-1])
    assert len(PreparedCrops(config).sets[0]) == 8
    assert "part-000000.npy: expected prepared examples" in warnings(capsys)[0]
    with pytest.raises(DataFileError, match=r"remove it and run python -m train\.prepare again"):
        PreparedSet(folder)
    np.save(part, np.zeros((8, 15, 64, 64), np.float16))
    with pytest.raises(DataFileError, match=r"expected examples of 16 planes, found shape \(8, 15, 64, 64\)"):
        PreparedCrops(config)


@pytest.fixture
def checkpoint(tmp_path):
    path = tmp_path / "last.pt"
    save_checkpoint(path, "arnet", SMALL, {"network": ARNet(SMALL).state_dict()})
    return path


def test_a_damaged_checkpoint_is_named_and_the_one_before_it_is_used(tmp_path, capsys):
    @dataclass(frozen=True)
    class Config:
        model: ARNetConfig = SMALL

    folder = RunFolder(tmp_path, "arnet", Config())
    for step in (1, 2, 3):
        folder.save({"network": ARNet(SMALL).state_dict(), "raw": {}, "optimizer": {}, "step": step})
    assert folder.load()["step"] == 3
    last = tmp_path / "last.pt"
    last.write_bytes(last.read_bytes()[:1000])
    assert folder.load()["step"] == 2
    message = capsys.readouterr().err
    assert re.search(r"last\.pt: expected a checkpoint.*resuming from previous\.pt", message)
    last.unlink()
    assert folder.load()["step"] == 2
    last.write_bytes(b"x")
    (tmp_path / "previous.pt").write_bytes(b"x")
    with pytest.raises(DataFileError, match=r"previous\.pt: expected a checkpoint"):
        folder.load()


def test_weights_of_another_shape_or_version_are_refused(checkpoint):
    wide = ARNet(ARNetConfig(width=12, num_blocks=1))
    with pytest.raises(
        ConfigError, match=r"holds weights of arnet with width = 8, but 12 was requested; give"
    ):
        load_weights(wide, checkpoint, "arnet")
    with pytest.raises(DataFileError, match="expected a checkpoint of error, found one of arnet"):
        load_network(checkpoint, "error")
    content = load_checkpoint(checkpoint)
    for broken, message in (
        (
            {**content, "network": wide.state_dict()},
            r"expected weights backbone\.\S+ of shape .*, found \(12",
        ),
        ({**content, "network": {}}, "found none; they are of another network or version"),
        ({**content, "config": {"depth": 3}}, "unknown key 'depth'"),
        ({"name": "arnet", "network": {}}, "expected a checkpoint of arnet or"),
        ({"step": 3}, "expected a checkpoint of arnet or"),
    ):
        torch.save(broken, checkpoint)
        with pytest.raises((DataFileError, ConfigError), match=message):
            load_network(checkpoint, "arnet")
    checkpoint.write_bytes(b"PK\3\4 no zip file")
    with pytest.raises(DataFileError, match="found something unreadable"):
        load_network(checkpoint, "arnet")


def test_weights_alone_are_not_exported(checkpoint, tmp_path):
    from train.export import main

    with pytest.raises(SystemExit) as caught:
        main(["--arnet", str(checkpoint), "--out", str(tmp_path / "weights")])
    assert str(caught.value.code).startswith(f"error: {checkpoint}: expected the checkpoint of a run")
    assert not (tmp_path / "weights").exists()


def test_a_run_is_not_gone_on_with_from_weights_alone_or_another_network(checkpoint):
    for name in ("arnet", "error"):
        with pytest.raises(DataFileError, match=f"expected a run of {name} to resume"):
            RunFolder(checkpoint.parent, name, config_of(4)).load()


def test_exported_networks_give_their_weights_back(tmp_path):
    """Authority: ONNX Runtime on the exported file."""
    torch.manual_seed(0)
    network = ARNet(SMALL)
    for parameter in network.parameters():  # equal ones, as biases of 0, would share one name in the file
        torch.nn.init.normal_(parameter, std=0.05)
    export_networks({"arnet": network}, tmp_path, {"classical": "rays"})
    fresh = ARNet(SMALL)
    load_weights(fresh, tmp_path, "arnet")
    for key, x in network.state_dict().items():
        assert torch.equal(fresh.state_dict()[key], x)
    rng = np.random.default_rng(0)
    arrays = [rng.random((1, c, 24, 16), dtype=np.float32) for c in (3, 1, 3)]
    expected = load_onnx(tmp_path, "arnet", ("image", "defocus", "classical"), 1)(*arrays)
    with torch.no_grad():
        result = load_network(tmp_path, "arnet")(*map(torch.from_numpy, arrays))
    for a, b in zip(result, expected, strict=True):
        np.testing.assert_allclose(a.numpy(), b, atol=1e-5)
    (tmp_path / "arnet.onnx").write_bytes((tmp_path / "arnet.onnx").read_bytes() + b" ")
    with pytest.raises(ModelFileError, match=r"arnet\.onnx: expected the file that .*manifest\.json names"):
        load_network(tmp_path, "arnet")
    (tmp_path / "manifest.json").write_text(json.dumps({"networks": []}))
    with pytest.raises(ModelFileError, match="expected an exported arnet"):
        load_network(tmp_path, "arnet")


def test_a_run_without_a_finite_gradient_stops_with_the_first_such_batch_and_its_weights_saved(tmp_path):
    """The saved batch is the one that the run saw, and the weights are those before it."""
    from bokehnet.errors import ParameterError
    from tests.unit.train.toy_run import batches

    config = config_of(100, bad_from=3, bad_to=100, checkpoint_every=3)
    with pytest.raises(
        ParameterError, match=r"none in 25 steps in a row up to step 27; inspect the first of these"
    ):
        start(config, tmp_path)
    saved = torch.load(tmp_path / "bad_batch-0.pt", weights_only=True)
    assert saved["step"] == 3
    assert torch.equal(saved["batch"]["x"], next(iter(batches(config, 3)))["x"])
    kept = load_checkpoint(tmp_path / "last.pt")
    assert all(torch.equal(kept["raw"][key], x) for key, x in saved["raw"].items())
