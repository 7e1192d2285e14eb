import numpy as np
import pytest
import torch

from bokehnet.errors import ConfigError, LensError
from bokehnet.io.image import write_image
from bokehnet.lenses import Rays, ThinLens, TiltShift
from bokehnet.raytrace.camera import Camera
from bokehnet.scenes import read_scene
from bokehnet.scenes.reader import _check_transmission

SCENE = """
[camera]
width = 24
height = 16

[lens]
focal_length = 50.0
f_number = 1.4
focus_distance = 1.2

[environment]
color = [0.2, 0.3, 0.4]

[[quads]]
centre = [0.0, 0.1, 2.0]
u_axis = [1.0, 0.0, 0.0]
v_axis = [0.0, 0.0, 1.0]
material = { color = [0.5, 0.5, 0.5] }

[[spheres]]
name = "ball"
centre = [0.0, 0.0, 1.2]
radius = 0.1
velocity = [1.0, 0.0, 0.0]
material = { specular = [0.5, 0.5, 0.5], roughness = 0.2 }

[[lamps]]
position = [1.0, -1.0, 0.0]
intensity = [2.0, 2.0, 2.0]
"""

PLANE = "focus_points = [[-0.1, 0.1, 0.9], [0.2, 0.1, 1.0], [0.0, -0.2, 1.7]]"
LINE = "focus_points = [[0.0, 0.0, 1.0], [0.0, 0.0, 1.5], [0.0, 0.0, 2.0]]"


@pytest.fixture
def scene(tmp_path):
    """Write the scene with some text replaced."""

    def write(*changes, more=""):
        text = SCENE
        for old, new in changes:
            assert old in text
            text = text.replace(old, new)
        (tmp_path / "scene.toml").write_text(text + more)
        return tmp_path / "scene.toml"

    return write


def test_a_scene_file_becomes_a_world_in_millimetres(scene):
    job = read_scene(scene(), {"camera.width": 48, "render.seed": 5})
    floor, ball = job.world.bodies
    assert floor.shape.centre == (0, 100, 2000)
    assert (ball.name, ball.shape.radius, ball.velocity) == ("ball", 100, (1000, 0, 0))
    assert ball.material.roughness == 0.2
    assert job.world.lamps[0].position == (1000, -1000, 0)
    assert job.world.lamps[0].intensity == (2e6, 2e6, 2e6)  # irradiance at 1 m: 2
    assert job.world.environment.texture.flatten().tolist() == pytest.approx([0.2, 0.3, 0.4])
    assert (job.camera.width, job.camera.pixel_pitch, job.render.seed) == (48, 0.75, 5)
    assert job.camera.lens.focus_distance == 1200


def test_the_sensor_is_tilted_and_shifted_as_requested(scene):
    moved = "height = 16\ntilt = [-8.0, 3.0]\nshift = [0.5, -2.0]"
    lens = read_scene(scene(("height = 16", moved))).camera.lens
    thin = ThinLens(focal_length=50.0, f_number=1.4, focus_distance=1200.0)
    assert lens == TiltShift(lens=thin, tilt=(-8.0, 3.0), shift=(0.5, -2.0))
    assert read_scene(scene(("height = 16", "height = 16\ntilt = [0.0, 0.0]"))).camera.lens == thin


def test_the_plane_through_three_points_is_sharp(scene):
    """Authority: rays of one pixel through the whole pupil meet in one point of the plane."""
    lens = read_scene(scene(("height = 16", f"height = 16\n{PLANE}\nshift = [1.0, 0.0]"))).camera.lens
    points = 1000 * np.array([[-0.1, 0.1, 0.9], [0.2, 0.1, 1.0], [0.0, -0.2, 1.7]])
    normal = np.cross(points[1] - points[0], points[2] - points[0])
    pupil = np.array([[0.9, 0.0], [-0.5, 0.7], [0.0, -0.9], [0.3, 0.2]])
    for sensor_xy in ((0.0, 0.0), (15.0, -9.0)):
        rays = lens.sample_rays(np.tile(sensor_xy, (4, 1)), pupil)
        origin = np.column_stack([rays.origin, np.zeros(4)])
        direction = np.column_stack([rays.slope, np.ones(4)])
        met = origin + ((points[0] - origin) @ normal / (direction @ normal))[:, None] * direction
        assert np.ptp(met, axis=0) == pytest.approx(0, abs=1e-6)
    assert lens.shift == (1.0, 0.0)


def test_a_background_fills_the_frame_of_a_moved_sensor(scene):
    moved = "height = 16\ntilt = [10.0, 0.0]\nshift = [5.0, 0.0]"
    job = read_scene(scene(("height = 16", moved), more="[background]\ncolor = [0.5, 0.5, 0.5]\n"))
    sensor = torch.tensor([[x, y] for x in (-18.0, 18.0) for y in (-12.0, 12.0)])
    seen = job.camera.lens.sample_rays(sensor, torch.zeros(4, 2)).slope.abs().amax(0)
    assert job.world.backdrop.half_extent == pytest.approx(seen.tolist())
    assert float(seen[0]) > 22.9 / 52.2  # the far side of the shifted sensor, not half its width


def test_pictures_have_alpha_and_are_found_in_the_folder_of_the_scene_file(scene, tmp_path):
    import OpenImageIO as oiio  # noqa: N813

    rgba = np.zeros((2, 3, 4), np.uint8)
    rgba[0] = (255, 0, 0, 255)
    rgba[1] = (255, 255, 255, 51)
    spec = oiio.ImageSpec(3, 2, 4, "uint8")
    spec.attribute("oiio:UnassociatedAlpha", 1)
    output = oiio.ImageOutput.create(str(tmp_path / "card.png"))
    output.open(str(tmp_path / "card.png"), spec)
    output.write_image(rgba)
    output.close()
    job = read_scene(scene(("color = [0.5, 0.5, 0.5]", 'color = [0.5, 0.5, 0.5], texture = "card.png"')))
    texture = job.world.bodies[0].material.texture
    assert texture[:, 0, 0].tolist() == pytest.approx([1, 0, 0, 1])
    assert texture[:, 1, 0].tolist() == pytest.approx([0.2, 0.2, 0.2, 0.2], abs=1e-3)


def test_the_background_fills_the_frame(scene, tmp_path):
    write_image(tmp_path / "back.png", np.full((4, 6, 3), 0.5, np.float32))
    job = read_scene(scene(more='[background]\ntexture = "back.png"\ndepth = 10.0\n'))
    backdrop = job.world.backdrop
    half_width = 36 / 2 / job.camera.lens.sensor_distance
    assert backdrop.half_extent == pytest.approx((half_width, half_width * 16 / 24))
    assert backdrop.disparity == pytest.approx(1e-4)
    film = job.tracer().render(1)
    assert float(film.all_in_focus[0, 0, 0]) == pytest.approx(0.5, abs=0.01)


def test_mesh_files_are_read(scene, tmp_path):
    trimesh = pytest.importorskip("trimesh", reason="needs trimesh: pip install 'bokehnet[trace]'")
    pytest.importorskip("embreex", reason="needs embreex: pip install 'bokehnet[trace]'")
    trimesh.creation.box((0.2, 0.2, 0.2)).export(tmp_path / "box.glb")
    mesh = '[[meshes]]\nfile = "box.glb"\ncentre = [0.0, 0.0, 0.8]\nmaterial = { color = [0.4, 0.4, 0.4] }\n'
    maps = read_scene(scene(more=mesh)).tracer().maps()
    assert float(maps.depth[8, 12]) == pytest.approx(700, rel=1e-5)
    assert int(maps.body[8, 12]) == 2


def test_a_size_scales_a_mesh_and_centres_it(scene, tmp_path):
    """Authority: a cube of side 3 about (10, 0, 0), of 0.2 m at 0.8 m, has its front at 0.7 m."""
    trimesh = pytest.importorskip("trimesh", reason="needs trimesh: pip install 'bokehnet[trace]'")
    pytest.importorskip("embreex", reason="needs embreex: pip install 'bokehnet[trace]'")
    box = trimesh.creation.box((3, 3, 3))
    box.apply_translation((10, 0, 0))
    box.export(tmp_path / "box.ply")
    table = 'file = "box.ply"\nsize = 0.2\ncentre = [0.0, 0.0, 0.8]\nmaterial = { color = [0.4, 0.4, 0.4] }\n'
    maps = read_scene(scene(more=f"[[meshes]]\n{table}")).tracer().maps()
    assert float(maps.depth[8, 12]) == pytest.approx(700, rel=1e-5)
    with pytest.raises(ConfigError, match=r"meshes\[0\]: size: expected more than 0 m, got -0\.2"):
        read_scene(scene(more=f"[[meshes]]\n{table.replace('0.2', '-0.2')}"))


def test_the_digest_changes_with_all_that_the_picture_depends_on_but_its_samples(scene, tmp_path):
    write_image(tmp_path / "sky.hdr", np.full((4, 6, 3), 0.5, np.float32))
    textured = ("color = [0.2, 0.3, 0.4]", 'color = [1.0, 1.0, 1.0]\ntexture = "sky.hdr"')
    first = read_scene(scene(textured)).digest
    assert read_scene(scene(textured), {"render.samples": 3}).digest == first
    assert read_scene(scene(textured), {"render.seed": 3}).digest != first
    assert read_scene(scene(textured), {"camera.height": 17}).digest != first
    write_image(tmp_path / "sky.hdr", np.full((4, 6, 3), 0.6, np.float32))
    assert read_scene(scene(textured)).digest != first


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("radius = 0.1", "radius = 0.1\nred = 1", r"unknown key 'spheres\[0\]\.red'; valid keys: centre,"),
        ("centre = [0.0, 0.1, 2.0]", "centre = [0.0, nan, 2.0]", r"quads\[0\]: centre: .*finite.*nan"),
        ("radius = 0.1", "radius = inf", r"spheres\[0\]: radius: expected a finite number, got inf"),
        ("velocity = [1.0, 0.0, 0.0]", "velocity = [inf, 0.0, 0.0]", r"spheres\[0\]: velocity: .*finite"),
        ("radius = 0.1", "radius = 0.0", r"spheres\[0\]: radius: expected more than 0 mm"),
        ("u_axis = [1.0, 0.0, 0.0]", "u_axis = [0.0, 0.0, 0.0]", r"quads\[0\]: u_axis: expected two"),
        (
            "centre = [0.0, 0.1, 2.0]",
            "centre = [0.0, 2.0]",
            r"quads\[0\]\.centre: expected .*got \[0.0, 2.0\]",
        ),
        ("color = [0.5, 0.5, 0.5]", 'texture = "none.png"', r"quads\[0\]\.material\.texture: .*no such file"),
        (
            "color = [0.5, 0.5, 0.5]",
            "color = [0.5, 1.5, 0.5]",
            r"quads\[0\]\.material: color: .*`specular`.*1.5",
        ),
        ("color = [0.5, 0.5, 0.5]", "color = [0.0, 0.0, 0.0]", r"quads\[0\]\.material: expected a color"),
        ("roughness = 0.2", "roughness = 0.0", r"spheres\[0\]\.material: roughness: expected 0.001 to 1"),
        ("color = [0.2, 0.3, 0.4]", "color = [0.2, -0.3, 0.4]", r"environment: color: expected at least 0"),
        ("color = [0.2, 0.3, 0.4]", 'texture = "sky.hdr"', r"environment\.texture: .*no such file"),
        (
            "focus_distance = 1.2",
            "focus_distance = 0.04",
            r"lens\.focus_distance: need focus distance > focal",
        ),
        ("f_number = 1.4", "f_number = -1.4", r"lens: need a positive f-number, got -1.4"),
        ("focal_length = 50.0", 'name = "dubble_gauss"', r"lens: unknown lens 'dubble_gauss'"),
        ("focal_length = 50.0", "", r"lens: focal_length: .* for a thin lens, got none; give both"),
        ("width = 24", "width = 0", r"camera: width: expected at least 1, got 0"),
        ("height = 16", "height = 16\nsensor_width = 0.0", r"camera: sensor_width: expected more than 0 mm"),
        ("height = 16", "height = 16\nshutter = -1.0", r"camera: shutter: expected at least 0"),
        (
            "intensity = [2.0, 2.0, 2.0]",
            "intensity = [-2.0, 2.0, 2.0]",
            r"lamps\[0\]: intensity: expected at",
        ),
        (
            "height = 16",
            "height = 16\ntilt = [85.0, 0.0]",
            r"camera: tilt-shift: expected tilts up to 80",
        ),
        ("height = 16", "height = 16\nshift = [nan, 0.0]", r"camera: tilt-shift: expected .* finite shifts"),
        ("height = 16", "height = 16\ntilt = 5.0", r"camera\.tilt: expected"),
        ("height = 16", f"height = 16\n{LINE}", r"camera\.focus_points: .* three points off one line"),
        ("height = 16", f"height = 16\n{PLANE}\ntilt = [1.0, 0.0]", r"camera: focus_points: expected either"),
        ("[[lamps]]", "[render]\nsamples = 0\n[[lamps]]", r"render: samples: expected at least 1, got 0"),
        ("[[lamps]]", "[render]\nbounces = -1\n[[lamps]]", r"render: bounces: expected at least 0"),
    ],
)
def test_mistakes_are_reported_with_file_and_key(scene, old, new, message):
    path = scene((old, new))
    with pytest.raises(ConfigError, match=message) as caught:
        read_scene(path)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_lens_of_the_catalog_focuses_and_reports_where_it_cannot(scene):
    glass = ("focal_length = 50.0\nf_number = 1.4", 'name = "double_gauss"\nfocal_length = 50.0')
    lens = read_scene(scene(glass)).camera.lens
    assert (lens.focal_length, lens.focus_distance) == (pytest.approx(50), 1200)
    film = read_scene(scene(glass), {"render.dispersion": True}).tracer().render(2)
    assert bool(torch.isfinite(film.bokeh).all())
    with pytest.raises(ConfigError, match=r"scene\.toml: lens\.focus_distance: .*"):
        read_scene(scene(glass, ("focus_distance = 1.2", "focus_distance = 0.03")))


def test_missing_meshes_and_bad_backgrounds_are_reported_too(scene):
    pytest.importorskip("trimesh", reason="needs trimesh: pip install 'bokehnet[trace]'")
    mesh = '[[meshes]]\nfile = "none.glb"\nmaterial = { color = [0.4, 0.4, 0.4] }\n'
    with pytest.raises(ConfigError, match=r"scene\.toml: meshes\[0\]\.file: .*no such file"):
        read_scene(scene(more=mesh))
    with pytest.raises(ConfigError, match=r"scene\.toml: background: depth: expected more than 0 m"):
        read_scene(scene(more="[background]\ndepth = 0.0\n"))


def test_a_lens_that_passes_no_light_is_refused():
    class Closed:
        def sample_rays(self, sensor_xy, pupil_uv, wavelength=None):
            return Rays(origin=pupil_uv, slope=pupil_uv, weight=torch.zeros(pupil_uv.shape[:-1]))

    with pytest.raises(LensError, match="no light passes the lens"):
        _check_transmission(Camera(lens=Closed(), width=4, height=4, pixel_pitch=1.0))
