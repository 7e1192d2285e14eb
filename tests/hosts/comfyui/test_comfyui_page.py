"""An example of the nodes in the page of ComfyUI, in Chromium; needs what test_comfyui.py needs."""

import json
import time

from tests.end_to_end.conftest import browser  # noqa: F401
from tests.hosts.comfyui.test_comfyui import PACK, host, pytestmark  # noqa: F401

LOAD = """async ([text]) => {
  await app.handleFile(new File([text], "example.json", { type: "application/json" }));
}"""
TYPES = "() => Object.values(app.graph.nodes).map((node) => node.type)"


def test_the_page_loads_an_example_and_runs_it(host, browser):  # noqa: F811
    text = (PACK / "example_workflows/still.json").read_text()
    page = browser.new_page()
    page.goto(host.address, timeout=120_000)
    known = "() => window.app?.graph && window.LiteGraph?.registered_node_types?.BokehRender"
    page.wait_for_function(known, timeout=120_000)
    time.sleep(1)  # the page puts its own start in the graph
    expected = sorted(node["class_type"] for node in json.loads(text).values())
    page.evaluate(LOAD, [text])
    end = time.monotonic() + 60
    while sorted(page.evaluate(TYPES)) != expected:
        assert time.monotonic() < end, page.evaluate(TYPES)
        time.sleep(0.2)
    before = set(host.ask("/history")[1])
    page.evaluate("() => app.queuePrompt(0, 1)")
    end = time.monotonic() + 120
    while not (new := set(host.ask("/history")[1]) - before):
        assert time.monotonic() < end
        time.sleep(0.2)
    assert host.end(new.pop())["status"]["status_str"] == "success"
    page.close()
