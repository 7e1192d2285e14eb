import math

import numpy as np
import pytest
import torch

from bokehnet.errors import DataFileError, ParameterError
from bokehnet.raytrace.geometry.meshes import Mesh, read_mesh
from bokehnet.raytrace.geometry.quads import Quad
from bokehnet.raytrace.geometry.space import SpaceRays
from bokehnet.raytrace.geometry.spheres import Sphere

trimesh = pytest.importorskip("trimesh", reason="needs trimesh: pip install 'bokehnet[trace]'")
pytest.importorskip("embreex", reason="needs embreex: pip install 'bokehnet[trace]'")


def make_rays(origin, direction):
    origin, direction = (
        torch.as_tensor(np.asarray(a), dtype=torch.float32).reshape(-1, 3) for a in (origin, direction)
    )
    count = max(len(origin), len(direction))
    return SpaceRays(
        origin=origin.expand(count, 3), direction=direction.expand(count, 3), time=torch.zeros(count)
    )


def random_rays(count, seed, towards=(0, 0, 1000), spread=400):
    rng = np.random.default_rng(seed)
    origin = rng.normal(0, 300, (count, 3))
    return make_rays(origin, (rng.normal(0, spread, (count, 3)) + towards - origin) * 0.37)


def test_quad_hits_agree_with_the_linear_system():
    """Oracle: centre + a u + b v = origin + t direction, by numpy.linalg.solve."""
    quad = Quad(centre=(30, -20, 900), u_axis=(200, 50, 80), v_axis=(-40, 150, 90))
    rays = random_rays(500, 0)
    hits = quad.intersect(rays, torch.zeros(500))
    uv = quad.surface(rays, hits).uv
    axes = np.array([quad.u_axis, quad.v_axis], float)
    seen = 0
    for i in range(500):
        matrix = np.stack([*axes, -rays.direction[i].numpy()], 1)
        a, b, t = np.linalg.solve(matrix, rays.origin[i].numpy() - quad.centre)
        if min(abs(abs(a) - 1), abs(abs(b) - 1)) < 1e-4:
            continue
        if t > 0 and max(abs(a), abs(b)) < 1:
            seen += 1
            assert float(hits.distance[i]) == pytest.approx(t, rel=1e-4)
            assert uv[i].tolist() == pytest.approx([(a + 1) / 2, (b + 1) / 2], abs=1e-4)
        else:
            assert math.isinf(hits.distance[i])
    assert seen > 30


def test_sphere_is_hit_at_the_roots_of_its_equation():
    """Oracle: the quadratic equation in double precision."""
    ball = Sphere(centre=(10, 20, 1000), radius=150)
    rays = random_rays(500, 1, spread=120)
    first = ball.intersect(rays, torch.zeros(500)).distance
    second = ball.intersect(rays, first.where(first.isfinite(), torch.tensor(0.0))).distance
    origin, direction = rays.origin.double().numpy() - ball.centre, rays.direction.double().numpy()
    a, b = (direction**2).sum(1), 2 * (direction * origin).sum(1)
    root = b**2 - 4 * a * ((origin**2).sum(1) - ball.radius**2)
    hit = (root > 1e-3 * b**2) & (b < 0)
    assert 50 < hit.sum() < 450
    near, far = ((-b[hit] + sign * np.sqrt(root[hit])) / (2 * a[hit]) for sign in (-1, 1))
    assert first[hit].tolist() == pytest.approx(near.tolist(), rel=1e-4)
    assert second[hit].tolist() == pytest.approx(far.tolist(), rel=1e-4)
    assert first[root < 0].isinf().all()


def test_small_far_sphere_keeps_its_outline_in_single_precision():
    """Authority: a line misses a sphere when it passes its centre at more than the radius."""
    offset = np.linspace(0, 2, 401)
    offset = offset[np.abs(offset - 1) > 0.01]
    direction = np.stack([offset, 0 * offset, np.full_like(offset, 1e5)], -1)
    hits = Sphere(centre=(0, 0, 1e5), radius=1).intersect(
        make_rays((0, 0, 0), direction), torch.zeros(len(offset))
    )
    assert np.array_equal(hits.distance.isfinite().numpy(), offset < 1)


def test_sphere_from_within_is_hit_on_the_far_side():
    ball = Sphere(centre=(0, 0, 0), radius=2)
    hits = ball.intersect(make_rays((0, 0, 0), [(0, 0, 4), (0, -1, 0)]), torch.zeros(2))
    assert hits.distance.tolist() == pytest.approx([0.5, 2])


@pytest.mark.parametrize("smooth", [False, True])
def test_mesh_hits_agree_with_a_test_of_every_triangle(smooth):
    """Oracle: the linear system of every triangle and every ray, by numpy.linalg.solve."""
    ring = trimesh.creation.torus(200, 80, major_sections=16, minor_sections=12)
    ring.apply_translation([0, 0, 1000])
    mesh = Mesh(ring.vertices, ring.faces, normals=ring.vertex_normals if smooth else None)
    rays = random_rays(200, 2)
    hits = mesh.intersect(rays, torch.zeros(200))
    distance, nearest = np.full(200, np.inf), np.full(200, -1)
    corners = ring.vertices[ring.faces]
    for i in range(200):
        origin, direction = rays.origin[i].double().numpy(), rays.direction[i].double().numpy()
        edges = [corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]]
        matrix = np.stack([*edges, np.broadcast_to(-direction, edges[0].shape)], -1)
        u, v, t = np.linalg.solve(matrix, (origin - corners[:, 0])[..., None])[..., 0].T
        t = np.where((u >= 0) & (v >= 0) & (u + v <= 1) & (t > 0), t, np.inf)
        distance[i], nearest[i] = t.min(), t.argmin()
    hit = np.isfinite(distance)
    assert 20 < hit.sum() < 190
    assert np.array_equal(hit, hits.distance.isfinite().numpy())
    assert np.allclose(hits.distance[hit], distance[hit], rtol=1e-4)
    picked = torch.from_numpy(hit)
    surface = mesh.surface(
        make_rays(rays.origin[picked], rays.direction[picked]),
        type(hits)(distance=hits.distance[picked], element=hits.element[picked]),
    )
    cosine = (surface.normal.numpy() * ring.face_normals[nearest[hit]]).sum(1)
    assert cosine.min() > (0.8 if smooth else 1 - 1e-5)
    if smooth:
        assert cosine.min() < 1 - 1e-4


def test_rays_go_on_through_a_mesh_to_its_other_side():
    box = trimesh.creation.box((2, 2, 2))
    rays = make_rays((0.1, 0.2, -10), (0, 0, 2))
    mesh = Mesh(box.vertices, box.faces)
    distance = torch.zeros(1)
    results = []
    for _ in range(3):
        distance = mesh.intersect(rays, distance).distance
        results.append(float(distance))
    assert results == pytest.approx([4.5, 5.5, math.inf], rel=1e-4)


@pytest.mark.parametrize("point", [(0.0, 0.0, 0.0), (80.0, -120.0, 40.0), (300.0, 0.0, 190.0)])
def test_sampled_sphere_fills_its_solid_angle(point):
    """Authority: a sphere fills 2 pi (1 - cos(asin(r / d)))."""
    ball = Sphere(centre=(20, 10, 200), radius=30)
    squares = torch.rand(2000, 2, generator=torch.Generator().manual_seed(0))
    way, angle = ball.sample(torch.tensor([point]).expand(2000, 3), squares)
    distance = np.linalg.norm(np.array(point) - ball.centre)
    assert float(angle.mean()) == pytest.approx(
        2 * math.pi * (1 - math.sqrt(1 - (ball.radius / distance) ** 2)), rel=1e-4
    )
    ends = way + torch.tensor([point]) - torch.tensor(ball.centre)
    assert torch.allclose(ends.norm(dim=-1), torch.tensor(30.0), rtol=1e-3)
    assert float(ball.sample(torch.tensor([ball.centre]), squares[:1])[1]) == 0


def test_sampled_quad_fills_its_solid_angle():
    """Authority: on its axis a rectangle 2a x 2b at distance d fills 4 asin(ab / sqrt((a2+d2)(b2+d2)))."""
    quad = Quad(centre=(0, 0, 100), u_axis=(60, 0, 0), v_axis=(0, 40, 0))
    squares = torch.rand(200000, 2, generator=torch.Generator().manual_seed(0))
    _, angle = quad.sample(torch.zeros(200000, 3), squares)
    exact = 4 * math.asin(60 * 40 / math.sqrt((60**2 + 100**2) * (40**2 + 100**2)))
    assert float(angle.mean()) == pytest.approx(exact, rel=2e-3)


def test_mesh_file_is_scaled_turned_and_moved(tmp_path):
    """Authority: y up and z towards the viewer become y down and z away; a turn about z takes x to y."""
    trimesh.Trimesh([[1, 0, 0], [0, 2, 0], [0, 0, 3]], [[0, 1, 2]]).export(tmp_path / "a.obj")
    mesh = read_mesh(tmp_path / "a.obj", scale=10, rotation=(0, 0, 90), centre=(0, 0, 500))
    assert np.allclose(mesh._corners[0], [[0, 10, 500], [20, 0, 500], [0, 0, 470]], atol=1e-4)


def test_bad_shapes_say_what_was_expected(tmp_path):
    with pytest.raises(ParameterError, match="two different directions"):
        Quad(centre=(0, 0, 1), u_axis=(1, 2, 3), v_axis=(2, 4, 6))
    with pytest.raises(ParameterError, match="radius: expected more than 0 mm, got -1"):
        Sphere(centre=(0, 0, 1), radius=-1)
    with pytest.raises(ParameterError, match="at least one triangle"):
        Mesh(np.zeros((3, 3)), np.zeros((0, 3), int))
    with pytest.raises(ParameterError, match=r"faces: expected corners 0 to 2, .* got 3"):
        Mesh(np.zeros((3, 3)), np.array([[0, 1, 3]]))
    with pytest.raises(DataFileError, match="no such file"):
        read_mesh(tmp_path / "none.obj")
    (tmp_path / "bad.glb").write_bytes(b"nonsense")
    with pytest.raises(DataFileError, match="cannot be read as a mesh"):
        read_mesh(tmp_path / "bad.glb")


def test_without_embree_meshes_say_what_to_install(python_process):
    source = (
        "import sys; sys.modules['embreex'] = None\n"
        "import numpy as np\n"
        "from bokehnet.errors import MissingExtraError\n"
        "from bokehnet.raytrace.geometry.meshes import Mesh\n"
        "try: Mesh(np.eye(3), np.array([[0, 1, 2]]))\n"
        "except MissingExtraError as error: print(error)\n"
    )
    assert python_process(source).out.strip() == "this needs embreex: pip install 'bokehnet[trace]'"
