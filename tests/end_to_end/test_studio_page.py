"""The studio as a hand meets it, in a browser."""

import json
import os
import shlex
import signal
import socket
import struct
import zlib
from pathlib import Path

import numpy as np
import pytest

from bokehnet.cli.app import run
from bokehnet.io.color.srgb import linear_to_srgb
from bokehnet.io.image import write_image, write_map
from bokehnet.render.renderer import BokehRenderer
from bokehnet.scene.scene import read_scene
from bokehnet.settings.settings import RenderSettings

from .conftest import Studio, until

THUMBNAILS = 120_000  # ms; they are rendered at low priority, behind whatever else the machine does
TOLD = {"camera": {"blur": 12}, "focus": {"value": 0}, "depth": {"repair": "off"}}


def rendered(files, **changes) -> np.ndarray:
    """The picture that Python makes, as bytes of sRGB."""
    reports = {**TOLD, "input": {"disparity": str(files / "map.png")}, **changes}
    settings = RenderSettings().updated(reports)
    scene = read_scene(files / "photo.png", settings)
    return np.rint(255 * linear_to_srgb(np.clip(BokehRenderer().render(scene, settings).bokeh, 0, 1)))


def at(page, x: float, y: float) -> tuple[float, float]:
    box = page.locator("#sheet").bounding_box()
    return box["x"] + x * box["width"], box["y"] + y * box["height"]


def put(page, name: str, value: object) -> None:
    """Move a slider as a hand does."""
    page.eval_on_selector(
        name,
        "(slider, to) => { slider.value = to; slider.dispatchEvent(new Event('input', {bubbles: true})); }",
        value,
    )


def command(page) -> str:
    return page.locator("#command").inner_text()


def await_command(page, words: str) -> None:
    """Wait until the shown command, which follows the picture, contains some words."""
    until(page, f"document.querySelector('#command').textContent.includes('{words}')")


def test_the_canvas_shows_the_picture_that_python_makes(page, files, pixels):
    assert page.evaluate("document.body.dataset.stage") == "final"
    assert np.abs(pixels(page)[..., :3] - rendered(files)).max() <= 1


def test_a_click_focuses_there(page, files, pixels, settle):
    settle(page, lambda: page.mouse.click(*at(page, 0.5, 0.5)))
    until(page, "document.querySelector('#command').textContent.includes('--focus-at 90,60')")
    assert np.abs(pixels(page)[..., :3] - rendered(files, focus={"at": [90, 60]})).max() <= 1


def test_the_wheel_turns_the_focus_ring(page, settle):
    page.mouse.move(*at(page, 0.5, 0.5))
    settle(page, lambda: page.mouse.wheel(0, -100))
    assert float(page.locator("#focus").input_value()) == pytest.approx(0.01)


def test_two_fingers_zoom_and_move_and_a_tap_still_focuses(browser, studio):
    """Authority: the distance of the fingers, from 80 to 160 pixels; the point between them stays there."""
    context = browser.new_context(viewport={"width": 390, "height": 844}, has_touch=True)
    page = context.new_page()
    page.goto(studio.address)
    page.wait_for_selector("body[data-settled]")
    hand, (x, y) = context.new_cdp_session(page), at(page, 0.1, 0.1)

    def touch(kind: str, *places: tuple[float, float]) -> None:
        points = [{"x": left, "y": top, "id": number} for number, (left, top) in enumerate(places)]
        hand.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points})

    touch("touchStart", (x, y))
    touch("touchEnd")
    until(page, "document.querySelector('#command').textContent.includes('--focus-at 18,12')")
    command, box = page.inner_text("#command"), page.locator("#sheet").bounding_box()
    x, y = at(page, 0.5, 0.5)
    touch("touchStart", (x - 40, y))
    touch("touchStart", (x - 40, y), (x + 40, y))
    for apart in range(45, 81, 5):
        touch("touchMove", (x - apart, y), (x + apart, y))
    until(page, "Math.abs(document.querySelector('#stage').dataset.zoom - 2) < 0.01")
    wide = page.locator("#sheet").bounding_box()
    assert wide["width"] == pytest.approx(2 * box["width"], rel=0.01)
    for start, size, middle in (("x", "width", x), ("y", "height", y)):
        places = [(middle - one[start]) / one[size] for one in (box, wide)]
        assert places[0] == pytest.approx(places[1], abs=0.02)
    touch("touchMove", (x - 60, y + 30), (x + 100, y + 30))
    until(page, f"document.querySelector('#sheet').getBoundingClientRect().y > {wide['y'] + 28}")
    moved = page.locator("#sheet").bounding_box()
    assert (moved["x"] - wide["x"], moved["y"] - wide["y"]) == pytest.approx((20, 30), abs=2)
    touch("touchEnd")
    assert page.inner_text("#command") == command  # neither finger has focused
    context.close()


def test_the_history_lists_each_change_and_returns_to_any(page, settle):
    """Authority: the changes that this test makes, oldest first."""
    first = page.inner_text("#command")
    settle(page, lambda: page.mouse.click(*at(page, 0.5, 0.5)))
    settle(page, lambda: page.locator("#presets [role=option]").nth(1).click())
    page.click("#history-button")
    words = page.locator("#history button").all_inner_texts()
    assert words[:2] == ["Opened", "Focus"]
    assert words[2].startswith("Preset ")
    assert page.locator("#history [aria-selected=true]").inner_text() == words[2]
    settle(page, lambda: page.locator("#history button").nth(0).click())
    until(page, f"document.querySelector('#command').textContent === {json.dumps(first)}")
    assert page.locator("#history [aria-selected=true]").inner_text() == "Opened"
    settle(page, lambda: page.locator("#history button").nth(1).click())
    until(page, "document.querySelector('#command').textContent.includes('--focus-at 90,60')")


def test_keys_move_the_cursor_and_focus(page, settle):
    page.focus("#stage")
    for _ in range(3):
        page.keyboard.press("ArrowRight")
    settle(page, lambda: page.keyboard.press("Enter"))
    until(page, "/--focus-at 9[0-9],60/.test(document.querySelector('#command').textContent)")
    settle(page, lambda: page.keyboard.press("-"))
    until(page, "!document.querySelector('#command').textContent.includes('--focus-at')")


def test_a_wrong_value_is_reported_next_to_its_control_and_the_picture_stays(page, pixels, settle):
    before = pixels(page)
    page.click("summary:has-text('Camera')")
    page.fill("#field-camera-blur", "-5")
    page.keyboard.press("Enter")
    fault = page.locator(".field:has(#field-camera-blur) .fault")
    fault.wait_for(state="visible")
    assert "expected a number of at least 0 pixels, got -5" in fault.inner_text()
    assert (pixels(page) == before).all()
    page.fill("#field-camera-blur", "12")
    settle(page, lambda: page.keyboard.press("Enter"))
    assert fault.inner_text() == ""


def test_a_stroke_changes_the_picture_and_undo_takes_it_back(page, pixels, settle):
    before = pixels(page)
    page.click("[data-tool=nearer]")
    page.mouse.move(*at(page, 0.1, 0.1))
    page.mouse.down()
    page.mouse.move(*at(page, 0.2, 0.15), steps=4)
    settle(page, page.mouse.up)
    painted = pixels(page)
    assert (painted != before).any()
    assert "photo_painted.exr" in command(page)
    settle(page, lambda: page.keyboard.press("Control+z"))
    assert (pixels(page) == before).all()
    settle(page, lambda: page.keyboard.press("Control+Shift+z"))
    assert (pixels(page) == painted).all()


def test_undo_takes_back_a_slider_and_a_preset(page, pixels, settle):
    before = pixels(page)
    settle(page, lambda: put(page, "#blur", 30))
    settle(page, lambda: page.click("[data-preset=soft-focus]"))
    assert page.get_attribute("[data-preset=soft-focus]", "aria-selected") == "true"
    settle(page, lambda: page.keyboard.press("Control+z"))
    assert page.get_attribute("[data-preset=soft-focus]", "aria-selected") == "false"
    await_command(page, "--blur 30")
    settle(page, lambda: page.keyboard.press("Control+z"))
    await_command(page, "--blur 12.0")
    assert (pixels(page) == before).all()


def test_a_double_click_on_a_label_resets_the_control(page, settle):
    settle(page, lambda: put(page, "#blur", 30))
    settle(page, lambda: page.dblclick("label[for=blur]"))
    await_command(page, "--blur 12.0")
    settle(page, lambda: page.mouse.click(*at(page, 0.5, 0.5)))
    await_command(page, "--focus-at")
    settle(page, lambda: page.dblclick("label[for=focus]"))
    await_command(page, "--focus 0.0")


def test_both_ends_of_the_sharp_range_can_be_dragged(page, files, pixels, settle):
    settle(page, lambda: put(page, "#focus-near", 0.5))
    await_command(page, "--focus-range 0.0,0.5")
    assert np.abs(pixels(page)[..., :3] - rendered(files, focus={"range": [0, 0.5]})).max() <= 1
    settle(page, lambda: put(page, "#focus", 0.5))  # moves both ends
    await_command(page, "--focus-range 0.25,0.75")


def test_ctrl_and_wheel_zoom_at_the_pointer_and_space_and_drag_move(page, settle):
    start = page.locator("#sheet").bounding_box()
    page.mouse.move(*at(page, 0.25, 0.25))
    page.keyboard.down("Control")
    for _ in range(4):
        page.mouse.wheel(0, -100)
    page.keyboard.up("Control")
    until(page, "document.querySelector('#stage').dataset.zoom === '2.44'")
    zoomed = page.locator("#sheet").bounding_box()
    assert zoomed["width"] == pytest.approx(1.25**4 * start["width"], rel=0.01)
    for axis, side in (("x", "width"), ("y", "height")):  # the point under the pointer stays
        assert zoomed[axis] + 0.25 * zoomed[side] == pytest.approx(start[axis] + 0.25 * start[side], abs=2)
    settle(page, lambda: page.mouse.click(*at(page, 0.25, 0.25)))
    until(page, "document.querySelector('#command').textContent.includes('--focus-at 45,30')")
    page.keyboard.down(" ")
    page.mouse.down()
    x, y = at(page, 0.25, 0.25)
    page.mouse.move(x + 30, y + 20)
    page.mouse.up()
    page.keyboard.up(" ")
    moved = page.locator("#sheet").bounding_box()
    assert (moved["x"] - zoomed["x"], moved["y"] - zoomed["y"]) == pytest.approx((30, 20), abs=1)
    page.keyboard.press("0")
    assert page.locator("#sheet").bounding_box() == start


def test_a_held_key_shows_the_original(page):
    page.focus("#stage")
    page.keyboard.down("b")
    until(page, "!document.querySelector('#before').hidden")
    assert page.evaluate("document.querySelector('#before').style.clipPath") == "inset(0px 0% 0px 0px)"
    page.keyboard.up("b")
    assert page.evaluate("document.querySelector('#before').hidden")


def test_the_brush_has_a_ring_and_a_tint_and_the_toolbar_stays(page, pixels):
    focus = page.locator("#undo").bounding_box()
    page.click("[data-tool=nearer]")
    assert page.locator("#undo").bounding_box() == focus
    page.mouse.move(*at(page, 0.2, 0.7))
    page.mouse.move(*at(page, 0.3, 0.7))
    radius = round(0.05 * 180)
    ring = pixels(page, "#marks")
    assert ring[84, 54 - radius - 1 : 54 - radius + 2, 3].max() > 100
    assert ring[84, 54, 3] == 0
    page.mouse.down()
    page.mouse.move(*at(page, 0.5, 0.7), steps=3)
    tint = pixels(page, "#marks")[84, 70]
    assert tint[0] > tint[2]  # orange, as what is nearer in the overlay
    assert tint[3] > 0
    page.keyboard.press("Escape")
    page.mouse.up()


def test_an_export_has_the_bytes_of_the_shown_command(page, tmp_path, monkeypatch):
    page.fill("#out-name", "mine.png")
    page.keyboard.press("Tab")
    until(page, "document.querySelector('#command').textContent.endsWith('mine.png')")
    with page.expect_download() as download:
        page.click("#export")
    monkeypatch.chdir(tmp_path)
    assert run([*shlex.split(command(page))[1:], "-q"]) == 0
    assert download.value.suggested_filename == "mine.png"
    assert download.value.path().read_bytes() == (tmp_path / "mine.png").read_bytes()


def test_an_export_shows_the_time_left(page):
    """Authority: the rule of three: after 10 s for a quarter, three quarters take 30 s."""
    running = {"state": "running", "share": 0.25, "seconds": 10, "name": "photo_bokeh.png"}
    idle = {name: {"state": "idle"} for name in ("repair", "light", "estimate")}
    page.route("**/api/jobs", lambda route: route.fulfill(json={**idle, "export": running}))
    page.route("**/api/export", lambda route: route.fulfill(json={}))
    page.click("#export")
    until(page, "document.querySelector('#export-status').textContent === 'About 30 s left'")
    page.unroute_all()


def test_a_reload_and_a_second_tab_show_the_same(page, pixels, settle):
    settle(page, lambda: put(page, "#focus", 1))
    before = pixels(page)
    other = page.context.new_page()
    other.goto(page.url)
    for each in (other, page):
        each.reload()
        each.wait_for_selector("body[data-settled]")
        assert (pixels(each) == before).all()
        assert float(each.locator("#focus").input_value()) == 1
    settle(other, lambda: put(other, "#focus", 0))
    assert (pixels(other) != before).any()
    other.close()


def large(side: int) -> bytes:
    """A PNG file of side x side black pixels, of which each row is stored."""

    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    packer, row = zlib.compressobj(1), bytes(1 + side)
    rows = b"".join([*(packer.compress(row) for _ in range(side)), packer.flush()])
    header = struct.pack(">IIBBBBB", side, side, 8, 0, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", rows) + chunk(b"IEND", b"")


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("broken.jpg", b"\xff\xd8\xff\xe0 no picture", "broken.jpg"),
        ("empty.png", b"", "empty.png"),
        ("notes.txt", b"text", "expected a file that ends in"),
        ("large.png", large(10_000), "pixels"),
    ],
    ids=["broken", "empty", "text", "100 MP"],
)
def test_a_file_that_cannot_be_opened_is_reported_and_the_picture_stays(
    page, pixels, settle, name, content, message
):
    before = pixels(page)
    page.set_input_files("#open", {"name": name, "mimeType": "image/png", "buffer": content})
    until(page, "document.querySelector('#error').textContent !== ''")
    assert message in page.locator("#error").inner_text()
    assert (pixels(page) == before).all()
    size = page.viewport_size
    settle(page, lambda: page.set_viewport_size({**size, "width": size["width"] - 300}))
    assert message in page.locator("#error").inner_text(), "only an action of the user may erase it"
    settle(page, lambda: put(page, "#focus", 0.5))
    assert page.locator("#error").inner_text() == ""
    page.set_viewport_size(size)


def test_before_and_after(page, files, pixels):
    put(page, "#compare", 50)
    until(page, "!document.querySelector('#before').hidden")
    scene = read_scene(
        files / "photo.png",
        RenderSettings().updated({**TOLD, "input": {"disparity": str(files / "map.png")}}),
    )
    sharp = np.rint(255 * linear_to_srgb(scene.image))
    until(page, "document.querySelector('#before').getContext('2d').getImageData(3, 3, 1, 1).data[3] > 0")
    assert np.abs(pixels(page, "#before")[..., :3] - sharp).max() <= 1


def test_loupe_and_overlays(page, pixels):
    page.keyboard.press("l")
    page.wait_for_selector("#loupe[data-stage=final]")
    assert pixels(page, "#loupe")[..., :3].std() > 0
    page.keyboard.press("d")
    until(page, "document.querySelector('#over').getContext('2d').getImageData(90, 60, 1, 1).data[3] > 0")
    depth = pixels(page, "#over")[..., :3].sum(-1)
    assert depth[60, 90] > depth[5, 5]  # near is light


def test_every_control_has_a_name_for_screen_readers(page):
    nameless = page.evaluate(
        """() => [...document.querySelectorAll("button, input, select, a, #loupe")].filter((one) => {
            const label = one.labels?.[0]?.textContent || one.getAttribute("aria-label") || one.textContent;
            return !label?.trim() && !one.closest("#sheet, figure, [aria-hidden=true]");
        }).map((one) => one.outerHTML)"""
    )
    assert nameless == []


@pytest.mark.parametrize(("width", "height"), [(390, 844), (320, 600), (1440, 900)])
def test_nothing_extends_beyond_the_screen(page, width, height):
    page.set_viewport_size({"width": width, "height": height})
    page.wait_for_timeout(400)
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    box = page.locator("#sheet").bounding_box()
    assert box["width"] > 0.4 * min(width, height)
    assert box["x"] >= 0
    assert box["x"] + box["width"] <= width


def test_a_script_inside_the_page_does_not_run(browser, studio):
    page = browser.new_page()
    page.goto(studio.address)
    page.wait_for_selector("body[data-ready]")
    page.evaluate(
        "() => { const script = document.createElement('script'); script.textContent = 'window.ran = true';"
        " document.body.append(script); }"
    )
    assert page.evaluate("window.ran") is None
    page.close()


def test_a_page_of_another_site_learns_nothing(browser, studio):
    page = browser.new_page()
    page.goto("data:text/html,<title>elsewhere</title>")
    answer = page.evaluate(
        "(address) => fetch(address).then((answer) => answer.text(), () => 'refused')",
        studio.address + "api/state",
    )
    assert answer == "refused"
    page.close()


def test_only_this_machine_can_reach_the_studio(studio):
    """Authority: the sockets of the process, as Linux lists them; 0100007F is 127.0.0.1."""
    port = int(studio.address.split(":")[2].split("/")[0])
    try:
        with open("/proc/net/tcp") as table:
            listening = [line.split()[1] for line in table if line.split()[3] == "0A"]
    except OSError:
        pytest.skip("needs /proc/net/tcp")
    assert [one for one in listening if one.endswith(f":{port:04X}")] == [f"0100007F:{port:04X}"]
    with socket.create_connection(("127.0.0.1", port)):
        pass


def helpers(process) -> list[int]:
    """The processes in which a studio does its long work, by the threads that began them."""
    threads = list(Path(f"/proc/{process.pid}/task").glob("*/children"))
    if not threads:
        pytest.skip("needs /proc")
    children = {child for thread in threads for child in thread.read_text().split()}
    return [int(one) for one in children if b"spawn_main" in Path(f"/proc/{one}/cmdline").read_bytes()]


def test_a_render_that_crashes_is_reported_and_the_next_one_works(page, files, studio, pixels, settle):
    """The process of the engine is stopped, then killed, once the quick picture is there."""
    working = helpers(studio.process)
    assert working
    for one in working:
        os.kill(one, signal.SIGSTOP)
    page.evaluate("() => { delete document.body.dataset.stage; }")
    put(page, "#focus", 1)
    until(page, "document.body.dataset.stage === 'scatter'")
    quick = pixels(page)
    for one in working:
        os.kill(one, signal.SIGKILL)
    until(page, "document.querySelector('#error').textContent.includes('died')")
    assert (pixels(page) == quick).all()
    settle(page, lambda: put(page, "#focus", 0))
    assert page.locator("#error").inner_text() == ""
    assert np.abs(pixels(page)[..., :3] - rendered(files)).max() <= 1


def test_a_photo_without_depth_shows_a_notice_and_can_be_painted(browser, files, settle):
    studio = Studio(files / "photo.png")
    page = browser.new_page(viewport={"width": 1280, "height": 800})
    try:
        page.goto(studio.address)
        page.wait_for_selector("body[data-settled]")
        assert "no depth" in page.locator("#banner").inner_text()
        assert page.evaluate("document.querySelector('#quick').inert")
        assert page.locator("#export").is_disabled()
        page.click("#estimate")
        page.wait_for_selector("#offer:not([hidden])")
        assert page.locator("#offer-text").inner_text()
        page.click("#paint")
        assert page.get_attribute("[data-tool=nearer]", "aria-checked") == "true"
        settle(page, lambda: page.mouse.click(*at(page, 0.5, 0.5)))
        assert page.locator("#banner").is_hidden()
        assert not page.evaluate("document.querySelector('#quick').inert")
        assert page.locator("#export").is_enabled()
    finally:
        page.close()
        studio.end()


def test_a_second_photo_replaces_looks_and_names_and_keeps_the_preset(browser, tmp_path, settle):
    """Of a small photo, as all presets are drawn twice."""
    write_image(tmp_path / "photo.png", np.random.default_rng(5).random((40, 60, 3), np.float32))
    write_map(tmp_path / "map.png", np.linspace(0, 1, 60, dtype=np.float32) * np.ones((40, 1), np.float32))
    studio = Studio(tmp_path / "photo.png", "--disparity", tmp_path / "map.png", "--engine", "scatter")
    page = browser.new_page(viewport={"width": 1280, "height": 800})
    try:
        page.goto(studio.address)
        page.wait_for_selector("body[data-presets]", timeout=THUMBNAILS)
        assert page.input_value("#out-name") == "photo_bokeh.png"
        settle(page, lambda: page.click("[data-preset=soft-focus]"))
        page.reload()
        page.wait_for_selector("body[data-presets]", timeout=THUMBNAILS)
        assert page.get_attribute("[data-preset=soft-focus]", "aria-selected") == "true"
        picture = (tmp_path / "photo.png").read_bytes()
        second = {"name": "second.png", "mimeType": "image/png", "buffer": picture}
        settle(page, lambda: page.set_input_files("#open", second))
        assert page.input_value("#out-name") == "second_bokeh.png"
        assert page.locator("#export-status").inner_text() == ""
        assert page.get_attribute("[data-preset=soft-focus]", "aria-selected") == "true"
    finally:
        page.close()
        studio.end()


def test_a_studio_that_is_killed_in_mid_render_is_reported(browser, files):
    studio = Studio(files / "photo.png", "--disparity", files / "map.png", "--blur", 12, "--focus", 0)
    page = browser.new_page()
    try:
        page.goto(studio.address)
        page.wait_for_selector("body[data-settled]")
        page.evaluate("document.querySelector('#focus').value = 1")
        page.dispatch_event("#focus", "input")
        studio.process.kill()
        until(page, "document.querySelector('#error').textContent.includes('The studio has stopped')")
    finally:
        page.close()
        studio.end()
