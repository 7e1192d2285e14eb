"""ONNX files compute what torch computes, and are refused when they do not."""

import hashlib
import json
from pathlib import Path

import numpy as np
import pytest
import torch

from bokehnet.errors import ModelFileError
from bokehnet.inference.session import load_networks
from bokehnet.models import onnx_export
from bokehnet.models.arnet import ARNet, ARNetConfig
from bokehnet.models.iunet import IUNet, IUNetConfig
from bokehnet.models.onnx_export import PARITY, export_networks


def random_networks() -> tuple[ARNet, IUNet]:
    torch.manual_seed(0)
    networks = ARNet(ARNetConfig(width=8, num_blocks=1)), IUNet(IUNetConfig(width=8, num_blocks=1))
    for network in networks:
        torch.nn.init.normal_(network.backbone.head.weight, std=0.01)
    return networks


@pytest.fixture(scope="module")
def exported(tmp_path_factory):
    folder = tmp_path_factory.mktemp("weights")
    networks = random_networks()
    differences = export_networks(*networks, folder, {"why": "test"})
    return folder, networks, differences


def test_export_proves_parity_at_other_sizes(exported):
    _, _, differences = exported
    assert set(differences) == {"arnet", "iunet"}
    assert max(differences.values()) <= PARITY


@pytest.mark.parametrize("size", [(26, 90), (64, 34)])
def test_sessions_equal_torch_at_sizes_never_exported(exported, size):
    folder, (arnet, iunet), _ = exported
    loaded = load_networks(folder)
    rng = np.random.default_rng(0)
    height, width = size
    image, classical = (rng.random((1, 3, height, width), dtype=np.float32) for _ in range(2))
    defocus = rng.uniform(-10, 10, (1, 1, height, width)).astype(np.float32)
    tensors = [torch.from_numpy(x) for x in (image, defocus, classical)]
    with torch.no_grad():
        wanted, wanted_map = arnet.eval()(*tensors)
    got, got_map = loaded.arnet(image, defocus, classical)
    np.testing.assert_allclose(got, wanted.numpy(), atol=PARITY)
    np.testing.assert_allclose(got_map, wanted_map.numpy(), atol=PARITY)
    coarse = rng.random((1, 3, height // 2, width // 2), dtype=np.float32)
    with torch.no_grad():
        wanted = iunet.eval()(*tensors, torch.from_numpy(coarse))
    np.testing.assert_allclose(loaded.iunet(image, defocus, classical, coarse), wanted.numpy(), atol=PARITY)


def test_manifest_holds_the_hash_of_each_file(exported):
    folder, _, _ = exported
    manifest = json.loads((folder / "manifest.json").read_text())
    for name in ("arnet", "iunet"):
        entry = manifest["networks"][name]
        assert entry["sha256"] == hashlib.sha256((folder / entry["file"]).read_bytes()).hexdigest()
    assert manifest["notes"] == {"why": "test"}


def test_files_tell_nothing_of_the_machine_that_exported(exported):
    folder, _, _ = exported
    for file in folder.iterdir():
        assert str(Path(__file__).parents[3]).encode() not in file.read_bytes()
        assert b"stack_trace" not in file.read_bytes()


def test_an_export_that_differs_is_refused_and_leaves_no_manifest(tmp_path, monkeypatch):
    monkeypatch.setattr(onnx_export, "PARITY", -1.0)
    with pytest.raises(ModelFileError, match="expected ONNX Runtime and torch to agree"):
        export_networks(*random_networks(), tmp_path, {})
    assert list(tmp_path.iterdir()) == []


def test_networks_with_different_units_do_not_go_together(tmp_path):
    with pytest.raises(ModelFileError, match=r"share one unit, got 10\.0 and 8\.0"):
        export_networks(ARNet(ARNetConfig(width=8)), IUNet(IUNetConfig(width=8, unit=8.0)), tmp_path, {})


@pytest.mark.parametrize(
    ("damage", "words"),
    [
        (lambda f: (f / "manifest.json").unlink(), "weights missing"),
        (lambda f: (f / "manifest.json").write_text("{"), "expected JSON"),
        (
            lambda f: (f / "manifest.json").write_text('{"format": 99}'),
            "expected manifest format 1, found 99",
        ),
        (lambda f: (f / "manifest.json").write_text('{"format": 1}'), "expected a number called unit"),
        (
            lambda f: (f / "manifest.json").write_text('{"format": 1, "unit": 9, "classical": "magic"}'),
            "expected classical to be one of rays, scatter, found magic",
        ),
        (
            lambda f: (f / "manifest.json").write_text('{"format": 1, "unit": 9, "classical": "rays"}'),
            "an entry for arnet",
        ),
        (lambda f: (f / "arnet.onnx").unlink(), "weights missing"),
        (lambda f: (f / "iunet.onnx").write_bytes(b"evil"), "expected sha256"),
    ],
)
def test_damaged_weights_are_refused_with_the_way_out(exported, tmp_path, damage, words):
    folder, _, _ = exported
    for file in folder.iterdir():
        (tmp_path / file.name).write_bytes(file.read_bytes())
    damage(tmp_path)
    with pytest.raises(ModelFileError, match=words):
        load_networks(tmp_path)
