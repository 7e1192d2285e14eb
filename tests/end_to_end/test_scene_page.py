"""The page of a 3-D scene in a browser: orbit, focus, lens."""

import json

import numpy as np
import pytest

from .conftest import ROOT, Studio, until

pytest.importorskip("torch", reason="scenes need the extra train")


@pytest.fixture(scope="module")
def scene_studio(tmp_path_factory):
    """A studio that traces few samples, so that it rests between tests."""
    pytest.importorskip("starlette", reason="needs the extra studio")
    text = (ROOT / "configs" / "scene_balls.toml").read_text(encoding="utf-8")
    scene = tmp_path_factory.mktemp("scene") / "balls.toml"
    scene.write_text(text.replace("samples = 256", "samples = 8"), encoding="utf-8")
    studio = Studio(scene)
    yield studio
    studio.end()


@pytest.fixture
def scene_page(browser, scene_studio):
    context = browser.new_context(viewport={"width": 1280, "height": 800})
    opened, faults = context.new_page(), []
    opened.on("pageerror", lambda error: faults.append(str(error)))
    opened.on(
        "console", lambda result: faults.append(result.text) if "Content Security" in result.text else None
    )
    opened.goto(scene_studio.address)
    until(opened, "document.body.dataset.stage === 'traced'")
    yield opened
    assert faults == []
    context.close()


def drag(page, across: float, steps: int) -> None:
    box = page.locator("#result").bounding_box()
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    page.mouse.move(x, y)
    page.mouse.down()
    for step in range(steps):
        page.mouse.move(x + across * (step + 1) / steps, y)
        page.wait_for_timeout(10)


def test_a_drag_orbits_with_drafts_and_the_trace_follows(scene_page, pixels):
    before = pixels(scene_page)
    drafts = scene_page.evaluate("Number(document.body.dataset.drafts)")
    drag(scene_page, 200, 30)
    until(scene_page, f"Number(document.body.dataset.drafts) > {drafts + 2}")
    scene_page.mouse.up()
    until(
        scene_page, "document.body.dataset.stage === 'traced' && Number(document.body.dataset.samples) >= 4"
    )
    after = pixels(scene_page)
    assert after.shape == before.shape
    assert np.abs(after.astype(float) - before).mean() > 5
    assert "-70° across" in scene_page.locator("#status").inner_text()


def test_a_click_focuses_there(scene_page):
    """Authority: the scene; the front of the red ball is 1.1 to 1.2 m away."""
    box = scene_page.locator("#result").bounding_box()
    scene_page.mouse.click(box["x"] + 0.36 * box["width"], box["y"] + 0.55 * box["height"])
    until(scene_page, "Math.abs(Number(document.querySelector('#focus-distance').value) - 1.13) < 0.05")


def test_another_lens_and_a_wrong_one(scene_page):
    scene_page.select_option("#lens", "double_gauss")
    assert scene_page.input_value("#f-number") == ""  # fully open
    until(scene_page, "document.body.dataset.stage === 'traced'")
    assert scene_page.locator("#error").inner_text() == ""
    scene_page.fill("#focus-distance", "0.01")
    scene_page.press("#focus-distance", "Enter")
    until(scene_page, "document.querySelector('#error').textContent.includes('focus')")
    scene_page.click("#reset")
    until(scene_page, "document.querySelector('#error').textContent === ''")


def test_another_site_is_refused(browser, scene_studio):
    context = browser.new_context()
    headers = {"origin": "http://elsewhere.example"}
    response = context.request.post(f"{scene_studio.address}api/view", headers=headers, data=json.dumps({}))
    assert response.status == 403
    context.close()
