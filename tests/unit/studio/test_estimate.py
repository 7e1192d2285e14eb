"""Depth of a photo that is estimated in the studio, by a network from a hub on this machine.

The studio runs in a process of its own, as ``huggingface_hub`` reads its variables when it is imported.
"""

import json
import os
import subprocess
import sys

import numpy as np
import pytest

from bokehnet.io.color.srgb import srgb_to_linear
from bokehnet.io.image import write_image
from tests.unit.inference.hub_server import hub_server, write_table

pytest.importorskip("huggingface_hub", reason="needs the extra models")

PROGRAM = """
import json, time
from pathlib import Path
from bokehnet.inference import depth_models
# The background process imports this file, too.
depth_models._TABLE, depth_models.PINS = Path("table.toml"), Path("pins.toml")

def wait(session):
    while session.jobs["estimate"]["state"] == "running":
        time.sleep(0.02)
    return session.jobs["estimate"]

def main():
    from bokehnet.settings.settings import RenderSettings
    from bokehnet.studio.looks import depth_offer
    from bokehnet.studio.session import Session

    session = Session()
    session.open(Path("photo.png"), RenderSettings())
    result = {"before": session.state()["flat"], "offer": depth_offer()}
    session.estimate(agreed=False)
    result["declined"], result["files"] = wait(session), len(list(Path("cache").rglob("blobs/*")))
    session.estimate(agreed=True)
    result["agreed"], state = wait(session), session.state()
    result |= {"after": state["flat"], "kind": state["kind"], "input": state["settings"]["input"]}
    result["values"] = [float(session.opened.values[24, column]) for column in (0, 63)]
    session.reopen(session.save())
    result["reopened"] = session.state()["settings"]["input"]
    session.close()
    print(json.dumps(result))

if __name__ == "__main__":
    main()
"""


@pytest.mark.slow
def test_depth_is_estimated_after_consent_only(tmp_path, write_red_network):
    """Authority: the network, which returns the red that it sees: 0.1 to 0.9 from left to right."""
    write_red_network(tmp_path)
    content = (tmp_path / "tiny.onnx").read_bytes()
    (tmp_path / "tiny.onnx").unlink()
    srgb = np.broadcast_to(np.linspace(0.1, 0.9, 64)[:, None], (48, 64, 3))
    write_image(tmp_path / "photo.png", srgb_to_linear(srgb))
    write_table(tmp_path, "tiny", "midas", content)
    (tmp_path / "program.py").write_text(PROGRAM)
    clean = {key: value for key, value in os.environ.items() if not key.startswith(("HF_", "BOKEHNET_"))}
    with hub_server({("tests/tiny", "onnx/model.onnx"): content}) as hub:
        variables = {
            "HF_HOME": str(tmp_path / "cache"),
            "HF_ENDPOINT": hub.address,
            "HF_HUB_DISABLE_XET": "1",
            "PYTHONPATH": os.pathsep.join(sys.path),
        }
        done = subprocess.run(
            [sys.executable, "program.py"],
            cwd=tmp_path,
            env=clean | variables,
            capture_output=True,
            text=True,
            timeout=200,
            stdin=subprocess.DEVNULL,
        )
    assert done.returncode == 0, done.stderr
    result = json.loads(done.stdout)
    assert result["before"]
    assert (result["offer"]["available"], result["offer"]["cached"]) == (True, False)
    assert "licence mit" in result["offer"]["text"]
    assert "declined" in result["declined"]["error"]
    assert result["files"] == 0
    assert result["agreed"] == {"state": "done"}
    assert (result["after"], result["kind"], result["input"]) == (False, "relative", {"depth_model": "tiny"})
    assert result["values"] == pytest.approx([0, 1], abs=0.1)
    assert result["reopened"] == {"depth_model": "tiny"}
