import numpy as np
import pytest

from bokehnet.synth.clutter.grid_mesh import box, lathe, moved, revolve, tube
from bokehnet.synth.clutter.objects import FOREGROUND, SOLID, THIN, rotation_about


def outwards(mesh, centre):
    """Smallest cosine between normals and the way from ``centre``, or from a line of centres."""
    way = mesh.points - centre
    return (mesh.normals * way / np.linalg.norm(way, axis=-1, keepdims=True)).sum(-1).min()


def test_normals_point_outwards():
    """Authority: the radius of a sphere and of a cylinder is their normal."""
    angle = np.linspace(0, np.pi, 40)
    sphere = revolve(np.stack([np.sin(angle), 1 + np.cos(angle)], -1), 0, 48)
    assert outwards(sphere, np.array([0, -1, 0])) > 0.99
    rope = tube(np.linspace([0, 0, 0], [0.3, -2, 1], 5), np.full(5, 0.1), 0, 24)
    middle = np.linspace([0, 0, 0], [0.3, -2, 1], 5)[:, None]
    assert outwards(rope, middle) > 0.99
    for mesh in (*box((1, 2, 3), 0, below=True), *lathe(np.array([[0.5, 1.0], [0.5, 0.0]]), 0)):
        assert outwards(mesh, np.array([0, -0.5, 0])) > -1e-9
    assert len(box((1, 2, 3), 0)) == 5


def test_moved_turns_before_it_shifts():
    (top,) = moved([box((1, 1, 1), 0)[4]], rotation_about(2, np.pi), (5, 0, 0))
    assert top.points[..., 1] == pytest.approx(1.0)
    assert top.points[..., 0].mean() == pytest.approx(5.0)


@pytest.mark.parametrize("thing", sorted({*SOLID, *THIN, *FOREGROUND}, key=lambda result: result.__name__))
def test_objects_stand_on_the_ground_with_the_drawn_materials(thing):
    for seed in range(10):
        rng = np.random.default_rng(seed)
        meshes = thing(rng, lambda: 7)
        points = np.concatenate([mesh.points.reshape(-1, 3) for mesh in meshes])
        assert np.isfinite(points).all()
        assert {mesh.texture for mesh in meshes} == {7}
        assert 0.1 < np.ptp(points[:, 1]) < 4
        # Leaves and loose strands may hang lower than the foot.
        assert np.quantile(points[:, 1], 0.9) < 0.15
