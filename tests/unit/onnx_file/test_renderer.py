"""The whole renderer in one file. Authority: the renderer of the package."""

import hashlib
import json
import shutil

import numpy as np
import pytest

onnx = pytest.importorskip("onnx", reason="needs onnx, of the extra train")

from bokehnet.engines.options import RenderOptions  # noqa: E402
from bokehnet.errors import ModelFileError, ParameterError  # noqa: E402
from bokehnet.inference.session import WEIGHTS  # noqa: E402
from bokehnet.onnx_file import neural, renderer  # noqa: E402
from bokehnet.optics.coc import defocus_from_disparity  # noqa: E402
from bokehnet.render.renderer import BokehRenderer  # noqa: E402
from tests.unit.onnx_file.running import decibels, picture, start, steps  # noqa: E402


@pytest.fixture(scope="module")
def model(random_weights):
    """With untrained networks: half of everything that the error map marks is theirs."""
    return renderer.build_model(random_weights)


@pytest.fixture(scope="module")
def render(model):
    session = start(model)

    def call(image, disparity, blur=1.0, focus=0.0, gamma=1.0):
        numbers = {"K": blur, "focus": focus, "gamma": gamma}
        scalars = {name: np.array(value, np.float32) for name, value in numbers.items()}
        return session.run(None, {"image": image, "disparity": disparity, **scalars})[0]

    return call


@pytest.fixture(scope="module")
def package(random_weights):
    return BokehRenderer("fast", weights=random_weights)


def bodies(graph):
    yield graph
    for node in graph.node:
        for attribute in node.attribute:
            if attribute.type == onnx.AttributeProto.GRAPH:
                yield from bodies(attribute.g)


def test_the_file_holds_standard_operators_only_and_describes_its_inputs(model):
    assert [item.domain for item in model.opset_import] == [""]
    nodes = [node for graph in bodies(model.graph) for node in graph.node]
    assert {node.domain for node in nodes} == {""}
    assert {"Loop", "If", "ScatterElements", "CumSum", "Conv"} <= {node.op_type for node in nodes}
    assert [item.name for item in model.graph.input] == ["image", "disparity", "K", "focus", "gamma"]
    assert [item.name for item in model.graph.output] == ["bokeh"]
    text = str(model.metadata_props) + "".join(node.doc_string for node in nodes)
    assert "scene-linear" in text
    assert "/" not in text  # no paths of the machine that exported


@pytest.mark.parametrize(
    ("height", "width", "blur"),
    [
        (40, 56, 0.0),
        (8, 9, 7.0),
        (1, 1, 3.0),
        (61, 47, 10.0),
        (61, 47, 10.01),
        (97, 131, 45.0),
        (530, 20, 25.0),
    ],
)
def test_it_renders_what_the_package_renders(render, package, height, width, blur):
    """No, one and three halvings; more rows than a band has."""
    image, disparity = picture(height, width), steps(height, width, 1)
    expected = package.render_arrays(image, disparity * np.float32(blur))
    assert blur < 5 or expected.error_map.max() > 0.1
    np.testing.assert_allclose(render(image, disparity, blur), expected.bokeh, rtol=0, atol=2e-5)


def test_focus_is_the_disparity_that_stays_sharp(render, package):
    image, disparity = picture(50, 60), np.abs(steps(50, 60, 1))
    defocus = defocus_from_disparity(disparity, np.float32(20), np.float32(0.3))
    expected = package.render_arrays(image, defocus).bokeh
    np.testing.assert_allclose(render(image, disparity, 20, 0.3), expected, rtol=0, atol=2e-5)


@pytest.mark.parametrize(("given", "limit"), [(9.0, 5.0), (0.01, 0.2), (-1.0, 0.2)])
def test_a_gamma_out_of_range_is_clipped(render, given, limit):
    image, disparity = picture(40, 50), steps(40, 50, 1)
    clipped = render(image, disparity, 5, gamma=limit)
    np.testing.assert_array_equal(render(image, disparity, 5, gamma=given), clipped)


def test_with_another_gamma_it_is_the_scatter(render):
    image, disparity = picture(50, 60), steps(50, 60, 1)
    expected = (
        BokehRenderer("scatter")
        .render_arrays(image, disparity * np.float32(15), options=RenderOptions(gamma=2.2))
        .bokeh
    )
    assert decibels(render(image, disparity, 15, gamma=2.2), expected) > 90
    assert decibels(render(image, disparity, 15), expected) < 40


def test_light_below_zero_counts_as_zero_and_light_above_one_is_kept(render, package):
    image, disparity = 4 * picture(40, 50) - 1, steps(40, 50, 1)
    result = render(image, disparity, 12)
    np.testing.assert_allclose(
        result, package.render_arrays(image, 12 * disparity).bokeh, rtol=2e-5, atol=2e-5
    )
    assert result.max() > 1


def test_sizes_that_differ_are_refused(render):
    with pytest.raises(Exception, match="Concat"):
        render(picture(40, 50), steps(40, 48, 1), 5)


@pytest.mark.parametrize(("engine", "megabytes"), [("fast", 5), ("neural", 6)])
def test_the_shipped_networks_are_exported_with_proof(tmp_path, engine, megabytes):
    path = tmp_path / "one.onnx"
    assert renderer.export_renderer(path, engine=engine) >= 70
    assert path.stat().st_size > megabytes * 1e6
    assert [file.name for file in tmp_path.iterdir()] == ["one.onnx"]


def test_engines_without_networks_on_the_scatter_are_refused(tmp_path):
    with pytest.raises(
        ParameterError, match="engine: expected one of bokehme, fast, neural, rays, got 'hybrid'"
    ):
        renderer.export_renderer(tmp_path / "one.onnx", engine="hybrid")
    assert not any(tmp_path.iterdir())


def test_a_file_that_renders_something_else_is_not_written(tmp_path, random_weights, monkeypatch):
    path = tmp_path / "fast.onnx"
    path.write_bytes(b"older")
    whole = neural.fuse
    monkeypatch.setattr(neural, "fuse", lambda *arrays: whole(*arrays) * 1.02)
    with pytest.raises(ModelFileError, match=r"fast\.onnx: expected at least 50 dB .* found [34]\d\."):
        renderer.export_renderer(path, random_weights)
    assert path.read_bytes() == b"older"


def test_a_network_on_the_rays_is_refused():
    with pytest.raises(ModelFileError, match="correct the scatter, found networks that correct the rays"):
        renderer.build_model(WEIGHTS / "hybrid")


def test_networks_of_another_operator_set_are_refused(tmp_path, random_weights):
    folder = tmp_path / "weights"
    shutil.copytree(random_weights, folder)
    network = onnx.load(folder / "arnet.onnx")
    network.opset_import[0].version = 19
    onnx.save(network, folder / "arnet.onnx")
    manifest = json.loads((folder / "manifest.json").read_text())
    digest = hashlib.sha256((folder / "arnet.onnx").read_bytes()).hexdigest()
    manifest["networks"]["arnet"]["sha256"] = digest
    (folder / "manifest.json").write_text(json.dumps(manifest))
    with pytest.raises(ModelFileError, match=r"arnet\.onnx: expected operator set 20"):
        renderer.build_model(folder)
