"""Pictures and state of the studio: previews equal the renderer's pictures."""

import dataclasses
import threading
import time

import numpy as np
import pytest

from bokehnet.errors import RenderCancelled
from bokehnet.inference import model_download
from bokehnet.io.color.color_space import SRGB
from bokehnet.io.color.srgb import linear_to_srgb
from bokehnet.io.image import write_image, write_map
from bokehnet.render.renderer import BokehRenderer
from bokehnet.scene.scene import read_scene
from bokehnet.settings.preset import load_preset, presets
from bokehnet.settings.settings import RenderSettings, all_settings, group_types
from bokehnet.studio import looks
from bokehnet.studio import session as studio_session
from bokehnet.studio.opened import Region
from bokehnet.studio.panels.help_texts import HELP_TEXTS, LABELS
from bokehnet.studio.panels.panels import is_path, panels
from bokehnet.studio.preview.display import to_rgba
from bokehnet.studio.preview.preview import Canvas

from .conftest import SIZE

ASKED = {"width": SIZE[0], "height": SIZE[1], "client": "tests"}


def shown(light: np.ndarray) -> np.ndarray:
    return np.rint(255 * linear_to_srgb(np.clip(light, 0, 1)))


def test_bytes_of_the_canvas_are_those_of_the_formula():
    """Authority: IEC 61966-2-1, as bokehnet.io.color.srgb has it in float32."""
    light = np.random.default_rng(0).random((40, 50, 3), dtype=np.float32) ** 3
    result = to_rgba(light, SRGB)
    assert np.abs(result[..., :3] - shown(light)).max() <= 1
    assert (result[..., :3] != shown(light)).mean() < 0.02
    assert (result[..., 3] == 255).all()


def test_the_last_preview_is_the_renderers_picture(client, opened, frames):
    actual = frames(client.post("api/preview", json=ASKED).content)
    assert [header["stage"] for header, _ in actual][-2:] == ["scatter", "final"]
    scene = read_scene(opened.opened.path, opened.settings)
    for engine, (_, pixels) in zip(("scatter", "rays"), actual[-2:], strict=True):
        result = BokehRenderer(engine).render(scene, opened.settings).bokeh
        assert np.abs(pixels[..., :3] - shown(result)).max() <= 1


def test_a_change_of_focus_comes_with_its_preview(client, opened, frames):
    requested = ASKED | {"changes": {"focus": {"at": [45, 35]}}}
    header, _ = frames(client.post("api/preview", json=requested).content)[0]
    assert header["settings"]["focus"] == {"at": [45, 35]}
    # the map runs from 0 to 1 once it is stretched, and the square is its nearest
    assert header["focus_disparity"] == pytest.approx(1)


def test_a_value_out_of_range_is_reported_with_its_setting_and_changes_nothing(client, opened):
    before = opened.settings
    answer = client.post("api/preview", json=ASKED | {"changes": {"camera": {"blur": -1}}})
    assert (answer.status_code, answer.json()["path"]) == (422, "camera.blur")
    assert "expected a number of at least 0 pixels, got -1" in answer.json()["error"]
    assert opened.settings == before


def test_null_brings_a_default_back(client, opened):
    client.post("api/change", json={"changes": {"aperture": {"blades": 6}}})
    assert opened.settings.aperture.blades == 6
    client.post("api/change", json={"changes": {"aperture": {"blades": None}}})
    assert opened.settings.aperture.blades == 0


def test_a_new_shape_comes_first_as_plain_discs(client, opened, frames):
    """Laying out a shape takes long; the first picture does not wait for it, and the next one knows it."""
    requested = ASKED | {"changes": {"aperture": {"blades": 3, "rotation": 20.0}}}
    result = frames(client.post("api/preview", json=requested).content)
    assert [header["stage"] for header, _ in result] == ["draft", "scatter", "final"]
    scene = read_scene(opened.opened.path, opened.settings)
    shaped = shown(BokehRenderer("scatter").render(scene, opened.settings).bokeh)
    assert np.abs(result[1][1][..., :3] - shaped).max() <= 1
    again = frames(client.post("api/preview", json=ASKED).content)
    assert (again[-2][1] == result[1][1]).all()


@pytest.mark.slow
def test_a_newer_request_of_the_same_page_ends_the_one_before(opened):
    previews = opened.previews
    first = previews.begin("page")
    assert not first.is_set()
    other, second = previews.begin("another page"), previews.begin("page")
    assert first.is_set()
    assert not other.is_set()
    stages = previews.stages(
        opened.opened, opened.settings, Canvas(size=SIZE, space="srgb"), first, lambda done, total: None
    )
    with pytest.raises(RenderCancelled):
        next(stages)
    assert not second.is_set()


def test_a_disabled_refinement_returns_at_once(opened):
    stop = threading.Event()
    threading.Timer(0.1, stop.set).start()
    begun = time.monotonic()
    with pytest.raises(RenderCancelled):
        opened.fine.run(wait_for_long, cancel=stop)
    assert time.monotonic() - begun < 1.5
    assert opened.fine.run(answer_at_once) == 42


def test_a_fault_in_mid_render_is_reported_and_the_next_picture_works(client, opened, frames, monkeypatch):
    whole = type(opened.previews).stages

    def broken(*arguments, **named):
        yield next(whole(opened.previews, *arguments[1:], **named))
        raise ZeroDivisionError("a fault\nof ours")

    with monkeypatch.context() as patch:
        patch.setattr(type(opened.previews), "stages", broken)
        result = frames(client.post("api/preview", json=ASKED).content)
    assert result[0][1] is not None
    assert result[-1][0]["error"] == "internal error: ZeroDivisionError: a fault of ours"
    assert frames(client.post("api/preview", json=ASKED).content)[-1][0]["stage"] == "final"


def wait_for_long(*, report):
    for step in range(400):
        time.sleep(0.01)
        report(step, 400)


def answer_at_once(*, report):
    return 42


def test_the_loupe_shows_what_the_file_will_have(client, opened, frames):
    """A part is rendered with what lies around it, so that it is as in the whole."""
    client.post("api/change", json={"changes": {"engine": {"name": "scatter"}}})
    answer = client.post("api/loupe", json={"x": 0.5, "y": 0.5, "width": 32, "height": 24, "client": "a"})
    header, pixels = frames(answer.content)[-1]
    assert (header["width"], header["height"]) == (32, 24)
    scene = read_scene(opened.opened.path, opened.settings)
    whole = shown(BokehRenderer().render(scene, opened.settings).bokeh)
    assert np.abs(pixels[..., :3] - whole[20:44, 32:64]).max() <= 1


@pytest.mark.parametrize("kind", ["depth", "unrepaired", "focus", "confidence"])
def test_overlays_have_the_size_of_the_preview(client, opened, frames, kind):
    ((_, pixels),) = frames(client.get(f"api/overlay?kind={kind}&width=48&height=64").content)
    assert pixels.shape == (32, 48, 4)
    assert pixels[..., :3].std() > 0 or pixels[..., 3].std() > 0


def test_the_map_is_shown_before_and_after_its_repair(client, opened, frames):
    """Authority: the overlay of the map before the repair."""

    def overlay(kind: str) -> np.ndarray:
        ((_, pixels),) = frames(client.get(f"api/overlay?kind={kind}&width=96&height=64").content)
        return pixels

    before = overlay("depth")
    opened.opened.take_repaired(np.ascontiguousarray(opened.opened.values[:, ::-1]), True, "test")
    np.testing.assert_array_equal(overlay("unrepaired"), before)
    assert np.abs(overlay("depth").astype(int) - before).max() > 50


def test_the_focus_overlay_is_green_where_it_is_sharp(client, opened, frames):
    client.post("api/change", json={"changes": {"focus": {"at": [45, 35]}}})
    ((_, pixels),) = frames(client.get("api/overlay?kind=focus&width=96&height=64").content)
    assert pixels[35, 45, 1] == pixels[35, 45, :3].max()  # green: in focus
    assert pixels[5, 5, 2] == pixels[5, 5, :3].max()  # blue: behind it


def test_a_point_of_light_has_the_area_of_the_opening(client, opened, frames):
    """Authority: a square in the unit circle covers 2 / pi of it."""
    areas = []
    for blades in (0, 4):
        client.post("api/change", json={"changes": {"aperture": {"blades": blades}}})
        ((_, pixels),) = frames(client.get("api/aperture").content)
        areas.append((pixels[:, :96, 1] > 127).sum())
    assert areas[0] == pytest.approx(np.pi * 40**2, rel=0.03)
    assert areas[1] / areas[0] == pytest.approx(2 / np.pi, rel=0.03)


def test_every_setting_is_in_a_panel_unless_it_is_a_path():
    fields = {field["path"]: field for panel in panels() for field in panel["fields"]}
    assert [panel["title"] for panel in panels()] == [
        group.TITLE for group in group_types() if group.GROUP != "input"
    ]
    for path, known in all_settings().items():
        if path in fields:
            response = fields[path]
            assert (response["help"], response["unit"]) == (HELP_TEXTS.get(path, known.help), known.unit)
            assert "--" not in response["help"], path  # the page has no command line
            assert "`" not in response["help"], path
        else:
            hidden = is_path(known) or known.flag is None or known.group == "input"
            assert hidden or path in ("color.glass", "color.axial_map", "color.lateral_map"), path


def test_texts_of_the_page_belong_to_settings():
    assert (HELP_TEXTS | LABELS).keys() <= all_settings().keys()


def test_a_look_is_saved_as_a_preset_that_the_command_line_takes(client, opened, tmp_path):
    client.post("api/change", json={"changes": {"aperture": {"blades": 7}, "highlights": {"gamma": 1.5}}})
    path = tmp_path / "mine.toml"
    path.write_text(client.get("api/preset").text)
    assert load_preset(path).values == {"aperture": {"blades": 7}, "highlights": {"gamma": 1.5}}


def test_a_preset_takes_the_place_of_the_look_and_leaves_the_scene(client, opened):
    client.post("api/change", json={"changes": {"aperture": {"blades": 7}}})
    client.post("api/wear", json={"preset": "petzval-swirl"})
    assert opened.settings.aperture.blades == 0
    assert opened.settings.aperture.cats_eye == 1.1
    assert opened.settings.camera.blur == 12
    assert [each["name"] for each in client.get("api/presets").json()] == presets()


def test_a_thumbnail_shows_the_picture_with_a_look(client, opened, frames):
    ((plain, one),) = frames(client.post("api/thumbnail", json={"preset": ""}).content)
    ((_, other),) = frames(client.post("api/thumbnail", json={"preset": "soft-focus"}).content)
    assert plain["width"] <= 144
    assert (one != other).any()
    assert opened.settings.aperture.cats_eye == 0


def test_a_session_is_saved_and_reopened(client, opened, frames):
    client.post("api/change", json={"changes": {"aperture": {"blades": 5}, "focus": {"at": [45, 35]}}})
    client.post("api/stroke", json={"stroke": {"effect": "nearer", "points": [[0.2, 0.2]], "radius": 0.1}})
    before = frames(client.post("api/preview", json=ASKED).content)[-1][1]
    saved = client.get("api/session").content
    client.post("api/change", json={"changes": {"aperture": {"blades": 0}}})
    client.post("api/undo")
    state = client.post("api/reopen", content=saved).json()
    assert (state["strokes"], state["settings"]["aperture"]) == (1, {"blades": 5})
    while client.get("api/state").json()["jobs"]["light"]["state"] == "running":
        time.sleep(0.01)
    assert (frames(client.post("api/preview", json=ASKED).content)[-1][1] == before).all()


def test_a_photo_without_depth_opens_flat_and_can_be_painted(client, session, files):
    state = client.post("api/open?name=photo.png", content=(files / "photo.png").read_bytes()).json()
    assert state["flat"]
    assert state["settings"]["camera"]["blur"] > 0
    client.post(
        "api/stroke",
        json={"stroke": {"effect": "nearer", "points": [[0.5, 0.5]], "radius": 0.2, "edges": False}},
    )
    values = session.opened.painted_map(session.settings)
    assert values[32, 48] == pytest.approx(0.6)
    assert values[2, 2] == 0.5


def test_the_focus_starts_on_the_subject(client, session, files):
    """Authority: the map, whose only near surface is the square, disparity 1 once stretched."""
    client.post("api/open?name=photo.png", content=(files / "photo.png").read_bytes())
    client.post("api/open?name=map.png&role=disparity", content=(files / "map.png").read_bytes())
    assert session.settings.focus.value == 1


def test_the_focus_covers_the_range_of_a_deep_subject(session, files, tmp_path):
    """Authority: the map: after stretching 0.2 to 0.8 to 0..1 the square runs from 0.88 to 1."""
    disparity = np.full((64, 96), 0.2, np.float32)
    disparity[20:50, 30:60] = np.linspace(0.73, 0.8, 30)
    write_map(tmp_path / "deep.png", disparity)
    session.open(
        files / "photo.png", RenderSettings().updated({"input": {"disparity": str(tmp_path / "deep.png")}})
    )
    assert session.settings.focus.range == pytest.approx((0.88, 1), abs=0.03)


def test_undo_restores_settings_presets_and_strokes_in_order(client, opened):
    first = opened.settings
    client.post("api/change", json={"changes": {"aperture": {"blades": 6}}})
    client.post("api/stroke", json={"stroke": {"effect": "nearer", "points": [[0.5, 0.5]], "radius": 0.1}})
    state = client.post("api/wear", json={"preset": "petzval-swirl"}).json()
    assert (state["preset"], state["done"]) == ("petzval-swirl", 3)
    state = client.post("api/undo").json()
    assert (state["preset"], state["strokes"], state["settings"]["aperture"]) == ("", 1, {"blades": 6})
    assert client.post("api/undo").json()["strokes"] == 0
    assert client.post("api/undo").json()["done"] == 0
    assert opened.settings == first
    for _ in range(3):
        state = client.post("api/redo").json()
    assert (state["preset"], state["strokes"], state["undone"]) == ("petzval-swirl", 1, 0)


def test_the_history_names_each_change_and_several_are_undone_at_once(client, opened):
    client.post("api/change", json={"changes": {"aperture": {"blades": 6}}})
    client.post("api/stroke", json={"stroke": {"effect": "nearer", "points": [[0.5, 0.5]], "radius": 0.1}})
    state = client.post("api/wear", json={"preset": "petzval-swirl"}).json()
    changes = ["Blades", "Brush: nearer", "Preset petzval-swirl"]
    assert (state["changes"], state["done"]) == (changes, 3)
    state = client.post("api/undo", json={"count": 2}).json()
    assert (state["changes"], state["done"], state["undone"]) == (changes, 1, 2)
    assert (state["preset"], state["strokes"]) == ("", 0)
    state = client.post("api/redo", json={"count": 9}).json()
    assert (state["done"], state["preset"]) == (3, "petzval-swirl")
    assert client.post("api/undo", json={"count": 0}).status_code == 400


def test_a_session_keeps_the_preset(client, opened):
    client.post("api/wear", json={"preset": "soft-focus"})
    saved = client.get("api/session").content
    client.post("api/wear", json={"preset": ""})
    assert client.post("api/reopen", content=saved).json()["preset"] == "soft-focus"


def test_a_drag_of_one_control_is_one_step(client, opened):
    for blur in (13, 14, 15):
        client.post("api/change", json={"changes": {"camera": {"blur": blur}}})
    assert client.post("api/change", json={"changes": {"camera": {"blur": 15}}}).json()["done"] == 1
    client.post("api/undo")
    assert opened.settings.camera.blur == 12


def test_a_new_picture_keeps_the_preset_and_drops_the_export(client, opened, exported, files):
    client.post("api/change", json={"changes": {"engine": {"name": "scatter"}}})
    exported("out.png")
    client.post("api/wear", json={"preset": "soft-focus"})
    state = client.post("api/open?name=other.png", content=(files / "photo.png").read_bytes()).json()
    assert state["preset"] == "soft-focus"
    assert state["settings"]["lens"] == client.get("api/state").json()["settings"]["lens"] != {}
    assert state["jobs"]["export"]["state"] == "idle"


def test_a_thumbnail_is_rendered_once_per_picture_and_settings(client, opened, monkeypatch):
    first = client.post("api/thumbnail", json={"preset": "soft-focus"}).content
    with monkeypatch.context() as patch:
        patch.setattr(type(opened.fine), "run", lambda *_, **__: pytest.fail("rendered again"))
        assert client.post("api/thumbnail", json={"preset": "soft-focus"}).content == first
    client.post("api/change", json={"changes": {"camera": {"blur": 30}}})
    assert client.post("api/thumbnail", json={"preset": "soft-focus"}).content != first


def test_an_f_number_of_a_relative_map_is_the_inverse_of_its_blur(client, opened, frames):
    """Authority: the formula of a thin lens, whose circle of confusion is inverse to the f-number."""

    def equivalents(camera):
        content = client.post("api/preview", json=ASKED | {"changes": {"camera": camera}}).content
        return frames(content)[0][0]["equivalents"]

    by_blur = equivalents({"blur": 12})
    by_stop = equivalents({"blur": None, "f_number": by_blur["f_number"]})
    assert by_stop["blur"] == pytest.approx(12)
    assert equivalents({"f_number": by_blur["f_number"] / 2})["blur"] == pytest.approx(24)


def test_the_preview_shows_estimated_light_as_the_export(tmp_path, session, client, frames):
    """Authority: the renderer with the file, which recovers the light of a lamp of 5x5 pixels at night."""
    street = np.full((64, 96, 3), 0.004, np.float32)
    street[30:35, 60:65] = 1
    disparity = np.full((64, 96), 0.2, np.float32)
    disparity[20:50, 10:30] = 0.8
    write_image(tmp_path / "street.png", street)
    write_map(tmp_path / "near.png", disparity)
    values = {
        "input": {"disparity": str(tmp_path / "near.png")},
        "camera": {"blur": 8},
        "focus": {"value": 1},
        "depth": {"repair": "off"},
        "engine": {"name": "scatter"},
    }
    session.open(tmp_path / "street.png", RenderSettings().updated(values))
    end = time.monotonic() + 60
    while client.get("api/jobs").json()["light"]["state"] == "running":
        assert time.monotonic() < end
        time.sleep(0.02)
    _, pixels = frames(client.post("api/preview", json=ASKED).content)[-1]
    expected = BokehRenderer().render(read_scene(tmp_path / "street.png", session.settings), session.settings)
    assert expected.report.light
    assert np.abs(pixels[..., :3] - shown(expected.bokeh)).max() <= 1
    ((_, over),) = frames(client.get("api/overlay?kind=light&width=96&height=64").content)
    assert over[32, 62, 0] == 255
    assert over[5, 5, 0] == 0
    ((_, before),) = frames(client.get("api/plain?width=96&height=64").content)
    assert np.abs(before[..., :3] - shown(street)).max() <= 1


def test_depth_is_estimated_only_after_consent(client, session, files, monkeypatch):
    client.post("api/open?name=photo.png", content=(files / "photo.png").read_bytes())
    monkeypatch.setattr(looks, "cached_file", lambda model: None)
    monkeypatch.delenv("BOKEHNET_DOWNLOADS", raising=False)
    monkeypatch.setattr(model_download, "cached_file", lambda model: None)
    monkeypatch.setattr(model_download, "download", lambda *_: pytest.fail("downloaded without consent"))
    offer = client.get("api/offer").json()
    assert offer["available"]
    assert offer["licence"] in offer["text"]
    client.post("api/estimate", json={})
    end = time.monotonic() + 60
    while (job := client.get("api/jobs").json()["estimate"])["state"] == "running":
        assert time.monotonic() < end
        time.sleep(0.02)
    assert "declined" in job["error"]


def test_an_estimate_leaves_a_picture_alone_that_was_opened_meanwhile(client, session, files, monkeypatch):
    picture = (files / "photo.png").read_bytes()
    client.post("api/open?name=photo.png", content=picture)
    monkeypatch.setattr(
        studio_session,
        "fetch_model",
        lambda *_: client.post("api/open?name=second.png", content=picture),
    )
    client.post("api/estimate", json={"agreed": True})
    end = time.monotonic() + 60
    while (job := client.get("api/jobs").json()["estimate"])["state"] == "running":
        assert time.monotonic() < end
        time.sleep(0.02)
    assert job["state"] == "idle"
    assert client.get("api/state").json()["name"] == "second.png"


def test_a_map_is_dropped_on_an_open_picture(client, session, files):
    client.post("api/open?name=photo.png", content=(files / "photo.png").read_bytes())
    state = client.post(
        "api/open?name=map.png&role=disparity", content=(files / "map.png").read_bytes()
    ).json()
    assert (state["kind"], state["flat"]) == ("relative", False)
    assert state["settings"]["input"] == {"disparity": "map.png"}  # its name, and no path


def test_files_that_nothing_needs_any_more_are_removed(client, session, files, frames):
    for _ in range(3):
        client.post("api/open?name=photo.png", content=(files / "photo.png").read_bytes())
        client.post("api/open?name=map.png&role=disparity", content=(files / "map.png").read_bytes())
        client.post("api/open?name=photo.png", content=b"broken")
    assert len(list(session.folder.rglob("photo.png"))) == 1
    assert len(list(session.folder.rglob("map.png"))) == 1
    requested = ASKED | {"changes": {"engine": {"name": "scatter"}}}
    assert frames(client.post("api/preview", json=requested).content)[-1][0]["stage"] == "scatter"


def test_the_look_stays_when_a_depth_map_arrives(client, files):
    assert "miniature" in presets()
    client.post("api/open?name=photo.png", content=(files / "photo.png").read_bytes())
    client.post("api/open?name=map.png&role=disparity", content=(files / "map.png").read_bytes())
    client.post("api/preview", json=ASKED | {"preset": "miniature"})
    client.post("api/open?name=photo.png", content=(files / "photo.png").read_bytes())
    state = client.post(
        "api/open?name=map.png&role=disparity", content=(files / "map.png").read_bytes()
    ).json()
    assert state["preset"] == "miniature"
    assert state["settings"]["focus"]["tilt_x"] == 70


def test_an_exr_with_depth_opens_with_its_own(client, session, tmp_path, write_channels):
    y, x = np.mgrid[:48, :64].astype(np.float32)
    write_channels(tmp_path / "shot.exr", R=x / 64, G=y / 48, B=x * 0 + 0.2, Z=1 + x / 16)
    state = client.post("api/open?name=shot.exr", content=(tmp_path / "shot.exr").read_bytes()).json()
    assert state["kind"] == "metric"
    assert state["settings"]["camera"]["focal_length"] == 50


def test_undo_and_redo(client, opened):
    dot = {"effect": "nearer", "points": [[0.5, 0.5]], "radius": 0.1}
    for _ in range(2):
        client.post("api/stroke", json={"stroke": dot})
    steps = [client.post(f"api/{name}").json() for name in ("undo", "undo", "undo", "redo")]
    assert [(state["strokes"], state["undone"]) for state in steps] == [(1, 1), (0, 2), (0, 2), (1, 1)]
    assert client.post("api/stroke", json={"stroke": dot}).json()["undone"] == 0


def test_a_region_next_to_the_border_is_the_part_of_the_whole(opened):
    region = Region(x=60, y=40, width=36, height=24)
    part = opened.opened.view(SIZE, opened.settings, region)
    assert (part.image == opened.opened.scene.image[40:, 60:]).all()
    assert (part.window.x, part.window.display_width) == (60, SIZE[0])
    assert dataclasses.is_dataclass(part)
