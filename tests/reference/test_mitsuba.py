"""The general tracer against Mitsuba 3, an independent renderer, whose ``thinlens`` sensor is ours.

Authority: Jakob et al., "Mitsuba 3 renderer", 2022. Both render at many samples; what remains is the noise
of both, so the bound on the difference is a bound on bias.
"""

import math

import numpy as np
import pytest
import torch

from bokehnet.lenses import ThinLens
from bokehnet.raytrace.camera import Camera
from bokehnet.raytrace.geometry.meshes import Mesh
from bokehnet.raytrace.geometry.quads import Quad
from bokehnet.raytrace.geometry.spheres import Sphere
from bokehnet.raytrace.surfaces.lights import Environment, PointLight
from bokehnet.raytrace.surfaces.materials import Material
from bokehnet.raytrace.tracer import Tracer
from bokehnet.raytrace.world import Body, World

mi = pytest.importorskip("mitsuba", reason="needs mitsuba: pip install 'bokehnet[dev]'")

WIDTH, HEIGHT, SENSOR_WIDTH = 96, 64, 36.0
pytestmark = pytest.mark.slow


@pytest.fixture(scope="module", autouse=True)
def _variant():
    mi.set_variant("scalar_rgb")


def their_sensor(lens, samples):
    """Theirs looks along z with y up; ours has y down."""
    fov = 2 * math.degrees(math.atan(SENSOR_WIDTH / 2 / lens.sensor_distance))
    return {
        "type": "thinlens",
        "aperture_radius": lens.pupil_radius,
        "focus_distance": lens.focus_distance,
        "fov": fov,
        "fov_axis": "x",
        "near_clip": 1.0,
        "far_clip": 1e6,
        "to_world": mi.ScalarTransform4f().look_at(origin=[0, 0, 0], target=[0, 0, 1], up=[0, -1, 0]),
        "film": {
            "type": "hdrfilm",
            "width": WIDTH,
            "height": HEIGHT,
            "pixel_format": "rgb",
            "rfilter": {"type": "box"},
        },
        "sampler": {"type": "multijitter", "sample_count": samples},
    }


def rgb(values):
    return {"type": "rgb", "value": [float(value) for value in values]}


def their_material(material):
    texture = material.texture[:3].permute(1, 2, 0).numpy()
    if texture[..., 0].size > 1:
        reflectance = {
            "type": "bitmap",
            "bitmap": mi.Bitmap(np.ascontiguousarray(texture * material.color[0])),
            "raw": True,
            "wrap_mode": "clamp",
        }
    else:
        reflectance = rgb(material.color)
    inner = {"type": "diffuse", "reflectance": reflectance}
    if any(material.specular):
        share = max(material.specular)
        gloss = {
            "type": "roughconductor",
            "material": "none",  # mirrors that reflect all light
            "distribution": "ggx",
            "alpha": material.roughness,
            "specular_reflectance": rgb(np.array(material.specular) / share),
        }
        inner["reflectance"] = rgb(np.array(material.color) / (1 - share))
        inner = {"type": "blendbsdf", "weight": share, "one": inner, "two": gloss}
    return {"type": "twosided", "bsdf": inner}


def their_shape(body):
    shape = body.shape
    if isinstance(shape, Quad):
        u, v = np.array(shape.u_axis), np.array(shape.v_axis)
        matrix = np.eye(4)
        matrix[:3] = np.stack([u, v, np.cross(u, v) / np.linalg.norm(np.cross(u, v)), shape.centre], 1)
        entry = {"type": "rectangle", "to_world": mi.ScalarTransform4f(matrix)}
    elif isinstance(shape, Sphere):
        entry = {"type": "sphere", "center": list(shape.centre), "radius": shape.radius}
    else:
        corners = shape._corners.reshape(-1, 3).numpy()
        entry = mi.Mesh("mesh", vertex_count=len(corners), face_count=len(corners) // 3)
        parameters = mi.traverse(entry)
        parameters["vertex_positions"] = corners.ravel()
        parameters["faces"] = np.arange(len(corners), dtype=np.uint32)
        parameters.update()
        return entry
    entry["bsdf"] = their_material(body.material)
    if any(body.material.emission):
        entry["emitter"] = {"type": "area", "radiance": rgb(body.material.emission)}
    return entry


def theirs(world, lens, bounces, samples):
    scene = {"type": "scene", "integrator": {"type": "path", "max_depth": bounces + 1, "rr_depth": 1000}}
    scene["sensor"] = their_sensor(lens, samples)
    radiance = world.environment.texture[:, 0, 0].tolist()
    if any(radiance):
        scene["sky"] = {"type": "constant", "radiance": rgb(radiance)}
    for index, lamp in enumerate(world.lamps):
        scene[f"lamp{index}"] = {
            "type": "point",
            "position": list(lamp.position),
            "intensity": rgb(lamp.intensity),
        }
    for index, body in enumerate(world.bodies):
        scene[f"body{index}"] = their_shape(body)
    return np.array(mi.render(mi.load_dict(scene), seed=1))


def ours(world, lens, bounces, samples):
    camera = Camera(lens=lens, width=WIDTH, height=HEIGHT, pixel_pitch=SENSOR_WIDTH / WIDTH)
    return Tracer(world, camera, seed=1, bounces=bounces).render(samples).bokeh.numpy()


def picture(seed):
    """Blocks of random colours with a bright corner, so that a turned or mirrored picture is found out."""
    rng = np.random.default_rng(seed)
    blocks = rng.uniform(0.05, 0.9, (8, 12, 3)).astype(np.float32)
    blocks[:2, :3] = 1
    rgba = np.concatenate([np.kron(blocks, np.ones((8, 8, 1), np.float32)), np.ones((64, 96, 1))], -1)
    return torch.from_numpy(rgba.transpose(2, 0, 1).astype(np.float32))


def cards():
    """Printed cards before, in and behind the focus, lit from all around."""
    bodies = [
        Body(
            shape=Quad(centre=centre, u_axis=u, v_axis=v),
            material=Material(color=(0.8, 0.8, 0.8), texture=picture(seed)),
        )
        for seed, (centre, u, v) in enumerate(
            [
                ((-110, 40, 700), (100, 10, 20), (-10, 70, 30)),
                ((60, -30, 1200), (180, 0, -60), (0, 120, 0)),
                ((100, 60, 2500), (1100, 100, 0), (-100, 800, 0)),
            ]
        )
    ]
    return World(bodies=tuple(bodies), environment=Environment(texture=torch.ones(3, 1, 1)))


def balls():
    """Glossy and dull balls on a floor under a lamp of some size: penumbrae and blurred reflections."""
    bodies = (
        Body(
            shape=Quad(centre=(0, 150, 2000), u_axis=(3000, 0, 0), v_axis=(0, 0, 1900)),
            material=Material(color=(0.6, 0.5, 0.4)),
        ),
        Body(
            shape=Sphere(centre=(-150, 60, 1300), radius=90),
            material=Material(color=(0.1, 0.3, 0.6), specular=(0.3, 0.3, 0.3), roughness=0.2),
        ),
        Body(shape=Sphere(centre=(130, 110, 800), radius=40), material=Material(color=(0.8, 0.2, 0.1))),
        Body(
            shape=Sphere(centre=(350, 0, 2600), radius=150),
            material=Material(specular=(0.5, 0.45, 0.35), roughness=0.05),
        ),
        Body(
            shape=Quad(centre=(-100, -900, 1300), u_axis=(0, 0, 300), v_axis=(300, 0, 0)),
            material=Material(emission=(5.0, 4.5, 4.0)),
        ),
    )
    lamp = PointLight(position=(600.0, -500.0, 500.0), intensity=(3e5, 3e5, 4e5))
    return World(bodies=bodies, lamps=(lamp,), environment=Environment(texture=torch.full((3, 1, 1), 0.5)))


def knots():
    """Triangle meshes near and far under a point light and a sky."""
    trimesh = pytest.importorskip("trimesh", reason="needs trimesh: pip install 'bokehnet[trace]'")
    pytest.importorskip("embreex", reason="needs embreex: pip install 'bokehnet[trace]'")
    ring = trimesh.creation.torus(80, 30)
    tilt = trimesh.transformations.rotation_matrix(0.9, [1, 0.4, 0])[:3, :3]
    grey = Material(color=(0.5, 0.5, 0.5))  # what Mitsuba gives a mesh without material
    bodies = tuple(
        Body(shape=Mesh(ring.vertices @ tilt.T * scale + centre, ring.faces), material=grey)
        for scale, centre in ((0.8, [-90, 40, 750]), (1, [60, -20, 1200]), (3, [300, -100, 3000]))
    )
    sky = torch.tensor([0.4, 0.6, 0.9]).reshape(3, 1, 1)
    lamp = PointLight(position=(500.0, -700.0, 600.0), intensity=(2e6, 1.6e6, 1e6))
    return World(bodies=bodies, lamps=(lamp,), environment=Environment(texture=sky))


@pytest.mark.parametrize(("scene", "bounces", "samples"), [(cards, 1, 256), (balls, 2, 256), (knots, 2, 256)])
def test_blurred_scenes_agree_with_mitsuba_to_40_db(scene, bounces, samples):
    world = scene()
    lens = ThinLens(focal_length=50.0, f_number=0.8, focus_distance=1200.0)
    difference = ours(world, lens, bounces, samples) - theirs(world, lens, bounces, samples)
    psnr = -10 * math.log10(float((difference**2).mean()))
    assert psnr >= 40
    assert abs(difference.mean()) < 1e-3
