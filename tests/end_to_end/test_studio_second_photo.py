"""A second photo in the studio, of another shape than the first one."""

import numpy as np
import pytest

from bokehnet.io.image import write_image

from .conftest import Studio, until


@pytest.fixture
def tall(tmp_path):
    """A photo of another shape than the one that the studio shows."""
    write_image(tmp_path / "tall.png", np.full((160, 80, 3), 0.5, np.float32))
    return tmp_path / "tall.png"


@pytest.fixture
def page(browser, files):
    """A page of a studio of its own, as it opens another picture."""
    studio = Studio(files / "photo.png", "--disparity", files / "map.png", "--blur", 12)
    context = browser.new_context(viewport={"width": 1280, "height": 800})
    try:
        page = context.new_page()
        page.goto(studio.address)
        page.wait_for_selector("body[data-settled]")
        yield page
    finally:
        context.close()
        studio.end()


def test_the_first_photo_is_gone_until_the_preview_of_the_second_is_there(page, tall, pixels):
    """It would be stretched to the shape of the second photo."""
    assert pixels(page)[..., 3].min() == 255
    page.route("**/api/preview", lambda route: None)  # holds the requests
    page.set_input_files("#open", tall)
    until(page, "document.querySelector('#name').textContent.includes('tall.png, 80 × 160')")
    shown = pixels(page)
    assert shown.shape[0] == 2 * shown.shape[1]
    assert shown.max() == 0
    count = page.evaluate("Number(document.body.dataset.settled)")
    page.unroute("**/api/preview")  # which then continue
    until(page, f"Number(document.body.dataset.settled) > {count}")
    assert pixels(page)[..., 3].min() == 255
