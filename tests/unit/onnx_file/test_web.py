"""The page for the browser, in headless Chromium. Authority: the renderer of the package."""

import base64
import functools
import http.server
import re
import runpy
import shutil
import subprocess

import numpy as np
import pytest

pytest.importorskip("onnx", reason="needs onnx, of the extra train")

from bokehnet.inference.depth_models import find_depth_model
from bokehnet.io.color.srgb import linear_to_srgb
from bokehnet.io.image import read_image, write_image, write_map
from bokehnet.io.maps import read_disparity
from bokehnet.onnx_file.depth_repair import build_repair
from bokehnet.onnx_file.renderer import build_model
from bokehnet.optics.coc import defocus_from_disparity
from bokehnet.render.renderer import BokehRenderer
from tests.conftest import ROOT
from tests.unit.onnx_file.browser import opened, program, served
from tests.unit.onnx_file.running import decibels, picture, start, steps

BLUR, FOCUS = 14.0, 0.4
# Compiles WebAssembly once: to optimise the runtime takes longer than to render these pictures without.
WORDS = "--no-sandbox", "--js-flags=--liftoff-only"
IMITATED_CARD = "--enable-unsafe-webgpu", "--use-webgpu-adapter=swiftshader"


@pytest.fixture(scope="module")
def packages(tmp_path_factory):
    """The page with its packages and the renderer."""
    npm, result = program("npm"), tmp_path_factory.mktemp("web")
    shutil.copytree(ROOT / "web", result, dirs_exist_ok=True)
    words = [npm, "install", "--no-audit", "--no-fund", "--ignore-scripts"]
    installed = subprocess.run(words, cwd=result, capture_output=True, text=True, timeout=200, check=False)
    if installed.returncode:
        pytest.skip(f"npm cannot install onnxruntime-web here: {installed.stderr.strip()[:200]}")
    (result / "fast.onnx").write_bytes(build_model().SerializeToString())
    return result


def write_pair(folder, height, width):
    """Write a photo and its disparity."""
    disparity = steps(height, width, 1)
    write_image(folder / "photo.png", picture(height, width))
    write_map(folder / "disparity.png", (disparity - disparity.min()) / np.ptp(disparity))


@pytest.fixture
def folder(packages, tmp_path):
    """The page with a photo and its disparity."""
    shutil.copytree(packages, tmp_path, dirs_exist_ok=True, ignore=shutil.ignore_patterns("node_modules"))
    (tmp_path / "node_modules").symlink_to(packages / "node_modules")
    write_pair(tmp_path, 83, 110)
    return tmp_path


@pytest.fixture
def address(folder):
    """Return the address on the page's own server."""
    server = served(folder, runpy.run_path(str(folder / "serve.py"))["Handler"])
    yield f"http://localhost:{server.server_port}"
    server.shutdown()


@pytest.fixture(scope="module")
def launched():
    """Headless Chromium, begun once for all tests that give it the same further words."""
    playwright = pytest.importorskip("playwright.sync_api")
    chromium = program("chromium", "chromium-browser", "google-chrome")
    with playwright.sync_playwright() as started:

        @functools.cache
        def launch(*words):
            return started.chromium.launch(executable_path=chromium, args=[*WORDS, *words])

        yield launch


@pytest.fixture
def page(launched):
    """A page of headless Chromium."""
    with opened(launched()) as result:
        yield result


def rendered(page):
    """Wait for the picture; the status of the page, and its pixels as sRGB values, (H, W, 3)."""
    page.wait_for_function(
        "/ in |Failed/.test(document.querySelector('#status').textContent)", timeout=200_000
    )
    saved = page.evaluate(
        """async () => {
            const blob = await (await fetch(document.querySelector("#save").href)).blob();
            const bytes = new Uint8Array(await blob.arrayBuffer());
            return btoa(Array.from(bytes, (code) => String.fromCharCode(code)).join(""));
        }"""
    )
    return page.inner_text("#status"), base64.b64decode(saved)


def shown(page, folder):
    """Wait for the picture; its sRGB values, (H, W, 3)."""
    (folder / "saved.png").write_bytes(rendered(page)[1])
    return linear_to_srgb(read_image(folder / "saved.png"))


def by_runtime(model, folder):
    """Return the picture of ONNX Runtime on the CPU with a file and K 6, as sRGB values."""
    fed = {"image": read_image(folder / "photo.png"), "disparity": read_disparity(folder / "disparity.png")}
    fed |= {"K": 6, "focus": FOCUS, "gamma": 1}
    fed = {name: np.asarray(value, np.float32) for name, value in fed.items()}
    return linear_to_srgb(np.clip(start(model).run(None, fed)[0], 0, 1))


def choose(page, folder, **names):
    """Put files into the form."""
    for control, name in names.items():
        page.set_input_files(f"[name={control}]", folder / f"{name}.png")


def wanted(folder, focus):
    """Return the picture of the package, as sRGB values."""
    image, disparity = read_image(folder / "photo.png"), read_disparity(folder / "disparity.png")
    defocus = defocus_from_disparity(disparity, BLUR, focus).astype(np.float32)
    return linear_to_srgb(np.clip(BokehRenderer("fast").render_arrays(image, defocus).bokeh, 0, 1))


@pytest.mark.slow
def test_the_page_renders_what_the_package_renders(folder, address, page):
    page.goto(f"{address}/?photo=photo.png&disparity=disparity.png&K={BLUR}&focus={FOCUS}")
    picture, image = shown(page, folder), read_image(folder / "photo.png")
    assert re.fullmatch(r"110x83 in \d+\.\d s", page.inner_text("#status"))
    assert decibels(picture, wanted(folder, FOCUS)) > 50
    assert decibels(picture, linear_to_srgb(image)) < 40


@pytest.mark.slow
@pytest.mark.parametrize("engine", ["rays", "bokehme"])
def test_the_page_renders_other_files(engine, folder, address, page):
    """Authority: ONNX Runtime on the CPU with the same file."""
    model = build_model(engine=engine)
    (folder / "other.onnx").write_bytes(model.SerializeToString())
    page.goto(f"{address}/?model=other.onnx&photo=photo.png&disparity=disparity.png&K=6&focus={FOCUS}")
    result = shown(page, folder)
    assert decibels(result, by_runtime(model, folder)) > 50
    assert decibels(result, linear_to_srgb(read_image(folder / "photo.png"))) < 40


@pytest.mark.slow
def test_the_quality_is_a_choice_of_the_page(folder, address, page):
    """Authority: ONNX Runtime on the CPU with the file of the rays; tiles as large as the picture."""
    model = build_model(engine="rays")
    (folder / "rays.onnx").write_bytes(model.SerializeToString())
    page.goto(f"{address}/?photo=photo.png&disparity=disparity.png&K=6&focus={FOCUS}")
    fast = shown(page, folder)
    page.locator("summary", has_text="More").click()
    page.select_option("[name=quality]", "rays.onnx")
    page.wait_for_function("/Rendering/.test(document.querySelector('#status').textContent)")
    expected = by_runtime(model, folder)
    assert decibels(shown(page, folder), expected) > 50
    assert decibels(fast, expected) < 45


@pytest.mark.slow
def test_a_blurred_map_is_sharpened_on_request(folder, address, page):
    """Authority: the picture with the true map, which the blurred one approaches by the repair only."""
    y, x = np.mgrid[:90, :120]
    true = np.where(np.hypot(y - 45, x - 50) < 25, 0.9, 0.2).astype(np.float32)
    windows = np.lib.stride_tricks.sliding_window_view(np.pad(true, 3, "edge"), (7, 7))
    write_image(folder / "photo.png", np.float32(0.1) + 0.6 * true[..., None] + 0.1 * picture(90, 120))
    (folder / "repair.onnx").write_bytes(build_repair().SerializeToString())
    pictures = []
    for disparity in (true, windows.mean((2, 3)).astype(np.float32)):
        write_map(folder / "disparity.png", disparity)
        page.goto(f"{address}/?photo=photo.png&disparity=disparity.png&K=12&focus=0.9")
        pictures.append(shown(page, folder))
    page.locator("summary", has_text="More").click()
    page.check("[name=sharpen]")
    page.wait_for_function("/Rendering/.test(document.querySelector('#status').textContent)")
    assert decibels(shown(page, folder), pictures[0]) > decibels(pictures[1], pictures[0]) + 3


@pytest.mark.slow
def test_a_picture_in_tiles_is_the_whole_one(folder, address, page):
    """The package renders all at once; the page in four tiles of at most 64 pixels and their surroundings."""
    worker = folder / "worker.js"
    worker.write_text(worker.read_text().replace("const TILE = 1024", "const TILE = 64"))
    page.goto(f"{address}/?photo=photo.png&disparity=disparity.png&K={BLUR}&focus={FOCUS}")
    picture = shown(page, folder)
    assert decibels(picture, wanted(folder, FOCUS)) > 50


@pytest.mark.slow
def test_a_click_focuses_there(folder, address, page):
    page.goto(f"{address}/?photo=photo.png&disparity=disparity.png&K={BLUR}&focus={FOCUS}")
    rendered(page)
    page.locator("#result").click(position={"x": 5, "y": 5})
    page.wait_for_function(f"document.querySelector('[name=focus]').value != '{FOCUS}'")
    focus = float(page.input_value("[name=focus]"))
    # the canvas may begin within a pixel of the screen
    near = read_disparity(folder / "disparity.png")[4:7, 4:7]
    assert near.min() - 0.003 < focus < near.max() + 0.003
    picture = shown(page, folder)
    assert decibels(picture, wanted(folder, focus)) > 50


@pytest.mark.slow
def test_a_broken_photo_is_reported_and_the_next_one_works(folder, address, page):
    (folder / "broken.png").write_bytes(b"nothing")
    page.goto(f"{address}/?photo=broken.png&disparity=disparity.png")
    page.wait_for_function(
        "document.querySelector('#status').textContent.startsWith('Failed')", timeout=60_000
    )
    assert "no picture that this browser can read" in page.inner_text("[data-fault=photo]")
    choose(page, folder, photo="photo")  # begins by itself, once: the disparity is there
    page.wait_for_function("/ in /.test(document.querySelector('#status').textContent)", timeout=200_000)
    assert page.inner_text("[data-fault=photo]") == ""
    shown = page.evaluate("document.querySelector('#save').href")
    choose(page, folder, disparity="broken")
    page.wait_for_function("document.querySelector('[data-fault=disparity]').textContent", timeout=60_000)
    assert page.evaluate("document.querySelector('#save').href") == shown
    assert page.is_visible("#save")


@pytest.mark.slow
def test_a_number_out_of_its_bounds_is_reported_next_to_its_control(folder, address, page):
    page.goto(f"{address}/?photo=photo.png&disparity=disparity.png&K={BLUR}&focus={FOCUS}")
    rendered(page)
    page.click("#controls summary")
    for wrong in ("", "9", "-3"):
        page.fill("[name=gamma]", wrong)
        page.wait_for_function("document.querySelector('[data-fault=gamma]').textContent")
        assert page.is_visible("#save")  # the picture stays
        page.fill("[name=gamma]", "1")
        page.wait_for_function("!document.querySelector('[data-fault=gamma]').textContent")
    assert "110x83 in" in rendered(page)[0]


@pytest.mark.slow
@pytest.mark.parametrize("names", [("photo", "disparity"), ("disparity", "photo")])
def test_dropped_files_are_rendered_at_once_in_any_order(folder, address, page, names):
    """Authority: the package's picture by the values that the sliders show."""
    page.goto(f"{address}/?K={BLUR}&focus={FOCUS}")
    encoded = [
        [f"{name}.png", base64.b64encode((folder / f"{name}.png").read_bytes()).decode()] for name in names
    ]
    page.evaluate(
        """(files) => {
            const data = new DataTransfer();
            for (const [name, text] of files) {
                data.items.add(new File([Uint8Array.from(atob(text), (one) => one.charCodeAt(0))], name));
            }
            const drop = new DragEvent("drop", { dataTransfer: data, bubbles: true });
            document.querySelector("#files").dispatchEvent(drop);
        }""",
        encoded,
    )
    assert decibels(shown(page, folder), wanted(folder, FOCUS)) > 50
    assert page.locator("form input[type=range]").count() == 2


@pytest.mark.slow
def test_the_sample_is_one_click(folder, address, page):
    for source, name in (("photo", "demo"), ("disparity", "demo_disparity")):
        shutil.copy(folder / f"{source}.png", folder / f"{name}.png")
    page.goto(address)
    assert page.evaluate("document.querySelector('#controls').inert")
    page.click("#sample")
    assert "110x83 in" in rendered(page)[0]
    assert not page.evaluate("document.querySelector('#controls').inert")
    assert not page.evaluate("document.querySelector('#without').open")


@pytest.mark.slow
def test_too_little_memory_is_reported_and_the_tiles_are_smaller(folder, address, page):
    """The error is what a browser throws that cannot give the memory of a tile above 256 pixels."""
    worker, call = folder / "worker.js", "const picture = await renderBokeh("
    text = worker.read_text()
    assert text.count(call) == 1
    worker.write_text(
        text.replace(call, f"if (tile > 256) throw new RangeError('Array buffer allocation failed');{call}")
    )
    page.goto(f"{address}/?photo=photo.png&disparity=disparity.png&K={BLUR}&focus={FOCUS}")
    (folder / "saved.png").write_bytes(rendered(page)[1])
    assert "Too little memory" in page.inner_text("#notice")
    assert "256 pixels wide now" in page.inner_text("#notice")
    assert decibels(linear_to_srgb(read_image(folder / "saved.png")), wanted(folder, FOCUS)) > 50


@pytest.mark.slow
def test_a_browser_without_webassembly_is_reported(folder, address, page):
    """Chromium takes it from pages alone; here the worker that needs it takes it from itself."""
    worker = folder / "worker.js"
    worker.write_text(worker.read_text() + "delete globalThis.WebAssembly;\n")
    page.goto(address)
    page.wait_for_function(
        "document.querySelector('#status').textContent.includes('no WebAssembly')", timeout=60_000
    )


@pytest.mark.slow
def test_a_browser_without_threads_and_webgl_is_reported_and_renders(folder, launched):
    """Nothing adds the headers that threads need: neither the host nor, where they are blocked, a worker."""
    server = served(folder, http.server.SimpleHTTPRequestHandler)
    query = f"photo=photo.png&disparity=disparity.png&K={BLUR}&focus={FOCUS}"
    try:
        browser = launched("--disable-gpu", "--disable-software-rasterizer")
        with opened(browser, service_workers="block") as page:
            page.goto(f"http://localhost:{server.server_port}/?{query}")
            (folder / "saved.png").write_bytes(rendered(page)[1])
            message = page.inner_text("#notice")
    finally:
        server.shutdown()
    assert "no threads: one core does all the work" in message
    assert "No quick picture while you drag" in message
    assert decibels(linear_to_srgb(read_image(folder / "saved.png")), wanted(folder, FOCUS)) > 50


@pytest.mark.slow
def test_a_drag_shows_a_quick_picture_and_the_renderers_after_it(folder, address, page):
    """Authority for the quick one: it is nearer to the package's picture than the sharp photo is."""
    page.goto(f"{address}/?photo=photo.png&disparity=disparity.png&K=0&focus={FOCUS}")
    rendered(page)
    page.evaluate(
        """(K) => {
            document.querySelector("[name=K]").value = K;
            document.querySelector("[name=K]").dispatchEvent(new Event("input", { bubbles: true }));
        }""",
        BLUR,
    )
    page.wait_for_function("window.previews > 0", timeout=60_000)
    codes = page.evaluate(
        """() => {
            const quick = document.querySelector("#preview"), copy = document.createElement("canvas");
            [copy.width, copy.height] = [110, 83];
            copy.getContext("2d").drawImage(quick, 0, 0, 110, 83);
            return [...copy.getContext("2d").getImageData(0, 0, 110, 83).data];
        }"""
    )
    result = np.array(codes, np.float32).reshape(83, 110, 4)[..., :3] / 255
    sharp = linear_to_srgb(read_image(folder / "photo.png"))
    assert decibels(result, wanted(folder, FOCUS)) > decibels(sharp, wanted(folder, FOCUS)) + 3
    page.wait_for_function("document.querySelector('#preview').hidden", timeout=200_000)
    assert decibels(shown(page, folder), wanted(folder, FOCUS)) > 50


@pytest.mark.slow
def test_a_host_without_headers_gets_threads(folder, page):
    """Authority: the browser, which says whether memory may be shared between threads."""
    server = served(folder, http.server.SimpleHTTPRequestHandler)
    try:
        page.goto(f"http://localhost:{server.server_port}/")
        page.wait_for_function("crossOriginIsolated && document.body.dataset.provider", timeout=60_000)
    finally:
        server.shutdown()


@pytest.mark.slow
def test_the_picture_of_webgpu_equals_that_of_the_package(folder, address, launched):
    """On the card that Chromium imitates by software, which is not taken if it draws another picture.

    It is slow, so the picture is small.
    """
    write_pair(folder, 45, 60)
    query = f"photo=photo.png&disparity=disparity.png&K={BLUR}&focus={FOCUS}&provider=webgpu"
    with opened(launched(*IMITATED_CARD)) as page:
        page.goto(f"{address}/?{query}")
        page.wait_for_function("document.body.dataset.provider", timeout=100_000)
        assert page.evaluate("document.body.dataset.provider") == "webgpu", page.inner_text("#notice")
        result = shown(page, folder)
    assert decibels(result, wanted(folder, FOCUS)) > 50


@pytest.mark.slow
def test_a_software_graphics_card_is_skipped_with_a_notice(folder, address, launched):
    with opened(launched(*IMITATED_CARD)) as page:
        page.goto(address)
        page.wait_for_function("document.body.dataset.provider", timeout=60_000)
        assert page.evaluate("document.body.dataset.provider") == "wasm"
        assert "WebAssembly does the work" in page.inner_text("#notice")


def depth_network(path, shape=(1, 3, "height", "width")):
    """Write a network in the convention of Hugging Face whose disparity is the red channel."""
    import onnx

    helper, kind = onnx.helper, onnx.TensorProto
    start, stop, axis = (
        onnx.numpy_helper.from_array(np.array([value], np.int64), name)
        for name, value in (("start", 0), ("stop", 1), ("axis", 1))
    )
    nodes = [
        helper.make_node("Slice", ["pixel_values", "start", "stop", "axis"], ["red"]),
        helper.make_node("Squeeze", ["red", "axis"], ["predicted_depth"]),
    ]
    graph = helper.make_graph(
        nodes,
        "tiny",
        [helper.make_tensor_value_info("pixel_values", kind.FLOAT, shape)],
        [helper.make_tensor_value_info("predicted_depth", kind.FLOAT, (1, *shape[2:]))],
        [start, stop, axis],
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=9)
    path.write_bytes(model.SerializeToString())


@pytest.fixture
def ramp(folder):
    """A photo whose red grows from left to right over a texture in green, and a depth network for it."""
    photo = picture(83, 110)
    photo[..., 0] = np.linspace(0, 1, 110, dtype=np.float32) ** 2.2
    write_image(folder / "ramp.png", photo)
    depth_network(folder / "tiny.onnx")
    return folder


def hosts_of(page):
    """List of the hosts that the page asks from now on, as it grows."""
    hosts = []
    page.context.on("request", lambda request: hosts.append(request.url.split("/")[2].split(":")[0]))
    return hosts


@pytest.mark.slow
def test_a_network_file_estimates_the_depth_of_a_photo_alone(ramp, address, page):
    """Authority: the network, whose disparity is the red of the photo, 0 at the left and 1 at the right."""
    hosts = hosts_of(page)
    page.goto(f"{address}/?K={BLUR}&focus={FOCUS}")
    page.set_input_files("[name=photo]", ramp / "ramp.png")
    assert page.is_visible("#download")  # offered once the photo has no map
    page.set_input_files("[name=network]", ramp / "tiny.onnx")
    assert "110x83 in" in rendered(page)[0]
    for x, expected in ((2, 0.02), (107, 0.98)):
        box = page.locator("#result").bounding_box()
        before = page.input_value("[name=focus]")
        page.locator("#result").click(position={"x": x / 110 * box["width"], "y": box["height"] / 2})
        page.wait_for_function(f"document.querySelector('[name=focus]').value != '{before}'")
        assert abs(float(page.input_value("[name=focus]")) - expected) < 0.03
        rendered(page)
    assert set(hosts) == {"localhost"}


@pytest.mark.slow
def test_a_network_is_downloaded_on_click_only_and_other_bytes_are_refused(ramp, address, page):
    """Nothing is requested before the click; the pinned address must have the pinned bytes."""
    hosts = hosts_of(page)
    headers = {"Access-Control-Allow-Origin": "*"}
    page.context.route("https://huggingface.co/**", lambda route: route.fulfill(body="none", headers=headers))
    page.goto(f"{address}/?K={BLUR}&focus={FOCUS}")
    page.set_input_files("[name=photo]", ramp / "ramp.png")
    page.wait_for_function("document.body.dataset.provider")
    assert set(hosts) == {"localhost"}
    page.click("#download")
    page.wait_for_function("document.querySelector('[data-fault=network]').textContent")
    assert "expected SHA-256 afb6a5c28f3b" in page.inner_text("[data-fault=network]")
    assert hosts.count("huggingface.co") == 1
    page.fill("[name=address]", f"{address}/missing.onnx")
    page.click("#download")
    page.wait_for_function("document.querySelector('[data-fault=network]').textContent.includes('404')")
    page.fill("[name=address]", f"{address}/tiny.onnx")
    page.click("#download")
    assert "110x83 in" in rendered(page)[0]
    assert page.inner_text("[data-fault=network]") == ""


@pytest.mark.slow
def test_an_invalid_depth_network_is_named_next_to_its_control(ramp, address, page):
    depth_network(ramp / "grey.onnx", (1, 1, "height", "width"))
    page.goto(address)
    page.set_input_files("[name=photo]", ramp / "ramp.png")
    for name, message in (
        ("photo.png", "no ONNX file"),
        ("grey.onnx", "expected one input (1, 3, height, width)"),
    ):
        page.set_input_files("[name=network]", ramp / name)
        page.wait_for_function(
            f"document.querySelector('[data-fault=network]').textContent.includes('{message}')",
            timeout=60_000,
        )
    page.set_input_files("[name=network]", ramp / "tiny.onnx")
    # not ``rendered``: the status still names the failure of the file before
    page.wait_for_function(
        "document.querySelector('#status').textContent.includes('110x83 in')", timeout=200_000
    )


def test_the_offered_network_is_the_pinned_one():
    text = (ROOT / "web/page.js").read_text(encoding="utf-8")
    model = find_depth_model("depth-anything-v2-small")
    assert f"huggingface.co/{model.repository}/resolve/{model.revision}/{model.file}" in text
    assert f'sha256: "{model.sha256}"' in text
    assert f"{model.bytes / 1e6:.0f} MB, {model.licence.capitalize()}" in text
