"""ONNX files compute what torch computes, and are refused when they do not."""

import hashlib
import json
import shutil
from functools import cache
from pathlib import Path

import numpy as np
import onnx
import pytest
import torch

from bokehnet.errors import ModelFileError
from bokehnet.inference.session import load_networks
from bokehnet.models import onnx_export
from bokehnet.models.arnet import ARNet, ARNetConfig
from bokehnet.models.checkpoint import load_network
from bokehnet.models.iunet import IUNet, IUNetConfig
from bokehnet.models.onnx_export import PARITY, export_networks
from bokehnet.render.renderer import BokehRenderer

# Names of shapes, and what makes their ARNet and IUNet.
SHAPES: dict[str, tuple[dict, dict]] = {
    "published": ({}, {}),
    "features": (
        {"unet": (8, 8, 8), "see_features": True},
        {"see_features": True, "carry_detail": True},
    ),
}


def random_networks(shape: str = "published") -> dict[str, ARNet | IUNet]:
    torch.manual_seed(0)
    coarse, fine = SHAPES[shape]
    networks = {
        "arnet": ARNet(ARNetConfig(width=8, num_blocks=1, **coarse)),
        "iunet": IUNet(IUNetConfig(width=8, num_blocks=1, **fine)),
    }
    for network in networks.values():
        torch.nn.init.normal_(network.backbone.head.weight, std=0.002)
    return networks


@pytest.fixture(scope="module")
def export_of(tmp_path_factory):
    """Folder, networks, differences and renderer of each shape, exported once: that takes seconds."""

    @cache
    def export(shape: str) -> tuple:
        folder = tmp_path_factory.mktemp("weights")
        networks = random_networks(shape)
        classical = "rays" if shape == "features" else "scatter"
        facts = {"classical": classical, "notes": {"why": "test"}, "max_valid_radius": 26.0}
        return folder, networks, export_networks(networks, folder, facts), classical

    return export


@pytest.fixture(scope="module", params=SHAPES)
def exported(export_of, request):
    return export_of(request.param)


def test_networks_that_need_features_behind_the_scatter_are_refused_in_one_line(export_of, tmp_path):
    """The scatter provides none; ONNX Runtime would complain about a rank at the first picture."""
    shutil.copytree(export_of("features")[0], tmp_path, dirs_exist_ok=True)
    manifest = json.loads((tmp_path / "manifest.json").read_text())
    del manifest["networks"]["iunet"]
    (tmp_path / "manifest.json").write_text(json.dumps({**manifest, "classical": "scatter"}))
    with pytest.raises(ModelFileError, match="networks without the input features"):
        load_networks(tmp_path, "scatter")


def test_a_small_unet_behind_the_scatter_renders(tmp_path):
    torch.manual_seed(0)
    export_networks({"arnet": ARNet(ARNetConfig(unet=(8, 8, 8)))}, tmp_path, {"classical": "scatter"})
    image = np.random.default_rng(0).random((48, 64, 3), dtype=np.float32)
    result = BokehRenderer("fast", weights=tmp_path).render_arrays(image, np.full((48, 64), 4, np.float32))
    assert result.bokeh.shape == image.shape
    assert np.isfinite(result.bokeh).all()


def test_export_proves_parity_at_other_sizes(exported):
    _, _, differences, _ = exported
    assert set(differences) == {"arnet", "iunet"}
    assert max(differences.values()) <= PARITY


@pytest.mark.parametrize("size", [(24, 88), (64, 40)])
def test_sessions_equal_torch_at_sizes_never_exported(exported, size):
    folder, networks, _, classical_name = exported
    arnet, iunet = (networks[name].eval() for name in ("arnet", "iunet"))
    loaded = load_networks(folder, classical_name)
    rng = np.random.default_rng(0)
    height, width = size
    image, classical = (rng.random((1, 3, height, width), dtype=np.float32) for _ in range(2))
    defocus = rng.uniform(-10, 10, (1, 1, height, width)).astype(np.float32)
    features = rng.random((1, 5, height, width), dtype=np.float32)
    coarse = rng.random((1, 3, height // 2, width // 2), dtype=np.float32)
    tensors = [torch.from_numpy(x) for x in (image, defocus, classical)]
    with torch.no_grad():
        expected, wanted_map = arnet(*tensors, torch.from_numpy(features))
        wanted_fine = iunet(*tensors, torch.from_numpy(coarse), torch.from_numpy(features))
    result, got_map = loaded.arnet(image, defocus, classical, features)
    np.testing.assert_allclose(result, expected.numpy(), atol=PARITY)
    np.testing.assert_allclose(got_map, wanted_map.numpy(), atol=PARITY)
    got_fine = loaded.iunet(image, defocus, classical, coarse, features)
    np.testing.assert_allclose(got_fine, wanted_fine.numpy(), atol=PARITY)


def test_manifest_holds_the_hash_of_each_file(exported):
    folder, *_ = exported
    manifest = json.loads((folder / "manifest.json").read_text())
    for name in ("arnet", "iunet"):
        entry = manifest["networks"][name]
        assert entry["sha256"] == hashlib.sha256((folder / entry["file"]).read_bytes()).hexdigest()
    assert manifest["notes"] == {"why": "test"}


def test_manifests_and_networks_of_earlier_versions_still_load(export_of, tmp_path):
    """Format 1 with the old keys, and ONNX files whose input is called hints."""
    shutil.copytree(export_of("features")[0], tmp_path, dirs_exist_ok=True)
    expected = load_networks(tmp_path, "rays")
    manifest = json.loads((tmp_path / "manifest.json").read_text())
    manifest["unit"] = manifest.pop("network_max_radius")
    manifest["trusted_radius"] = manifest.pop("max_valid_radius")
    for entry in manifest["networks"].values():
        path = tmp_path / entry["file"]
        model = onnx.load(path)
        for item in [*model.graph.input, *model.graph.value_info]:
            item.name = "hints" if item.name == "features" else item.name
        for node in model.graph.node:
            node.input[:] = ["hints" if name == "features" else name for name in node.input]
        onnx.save(model, path)
        entry["sha256"] = hashlib.sha256(path.read_bytes()).hexdigest()
    (tmp_path / "manifest.json").write_text(json.dumps(manifest))
    loaded = load_networks(tmp_path, "rays")
    assert (loaded.network_max_radius, loaded.max_valid_radius) == (10.0, 26.0)
    rng = np.random.default_rng(0)
    arrays = [rng.random((1, channels, 32, 48), dtype=np.float32) for channels in (3, 1, 3, 5)]
    for result, value in zip(loaded.arnet(*arrays), expected.arnet(*arrays), strict=True):
        np.testing.assert_array_equal(result, value)


def test_checkpoints_of_earlier_versions_still_load(tmp_path):
    """Their configuration has the old keys."""
    config = ARNetConfig(width=8, num_blocks=1, network_max_radius=8.0, see_features=True)
    network = ARNet(config)
    old = {"width": 8, "num_blocks": 1, "unit": 8.0, "see_hints": True}
    torch.save({"name": "arnet", "config": old, "network": network.state_dict()}, tmp_path / "last.pt")
    loaded = load_network(tmp_path / "last.pt", "arnet")
    assert loaded.config == config


def test_files_contain_nothing_of_the_exporting_machine(exported):
    folder, *_ = exported
    for file in folder.iterdir():
        assert str(Path(__file__).parents[3]).encode() not in file.read_bytes()
        assert b"stack_trace" not in file.read_bytes()


def test_an_export_that_differs_is_refused_and_leaves_no_manifest(tmp_path, monkeypatch):
    monkeypatch.setattr(onnx_export, "PARITY", -1.0)
    with pytest.raises(ModelFileError, match="expected ONNX Runtime and torch to agree"):
        export_networks(random_networks(), tmp_path, {})
    assert list(tmp_path.iterdir()) == []


def test_networks_with_different_radii_do_not_go_together(tmp_path):
    networks = {
        "arnet": ARNet(ARNetConfig(width=8)),
        "iunet": IUNet(IUNetConfig(width=8, network_max_radius=8.0)),
    }
    with pytest.raises(ModelFileError, match=r"share one network_max_radius, got 10\.0 and 8\.0"):
        export_networks(networks, tmp_path, {})


@pytest.mark.parametrize(
    ("damage", "words"),
    [
        (lambda f: (f / "manifest.json").unlink(), "weights missing"),
        (lambda f: (f / "manifest.json").write_text("{"), "expected JSON"),
        (
            lambda f: (f / "manifest.json").write_text('{"format": 99}'),
            "expected manifest format 1, found 99",
        ),
        (
            lambda f: (f / "manifest.json").write_text('{"format": 1}'),
            "expected a number called network_max_radius",
        ),
        (
            lambda f: (f / "manifest.json").write_text(
                '{"format": 1, "network_max_radius": 9, "classical": "magic"}'
            ),
            "expected classical to be one of rays, scatter, found magic",
        ),
        (
            lambda f: (f / "manifest.json").write_text(
                '{"format": 1, "network_max_radius": 9, "classical": "rays", "max_valid_radius": -1}'
            ),
            "expected max_valid_radius to be above 0, found -1",
        ),
        (
            lambda f: (f / "manifest.json").write_text(
                '{"format": 1, "network_max_radius": 9, "classical": "rays"}'
            ),
            "an entry for arnet",
        ),
        (lambda f: (f / "arnet.onnx").unlink(), "weights missing"),
        (lambda f: (f / "iunet.onnx").write_bytes(b"evil"), "expected sha256"),
    ],
)
def test_damaged_weights_are_refused_with_the_way_out(exported, tmp_path, damage, words):
    folder, _, _, classical = exported
    for file in folder.iterdir():
        (tmp_path / file.name).write_bytes(file.read_bytes())
    damage(tmp_path)
    with pytest.raises(ModelFileError, match=words):
        load_networks(tmp_path, classical)
