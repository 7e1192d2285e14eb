"""Runs in Krita, by kritarunner: a document with a depth layer is rendered, and the outcome is written.

Argument: the folder of the files; task.json in it has the program, its options and the depth layer's name.
"""

import json
from pathlib import Path

from krita import InfoObject, Krita

import bokehnet


def main(arguments) -> None:
    folder = Path(arguments[0])
    command, options, depth = json.loads((folder / "task.json").read_text())
    Krita.instance().setBatchmode(True)
    document = Krita.instance().openDocument(str(folder / "photo.png"))
    map_of = Krita.instance().openDocument(str(folder / "disparity.png"))
    reports = {"version": Krita.instance().version()}
    size = (0, 0, document.width(), document.height())
    map_of.setColorSpace(document.colorModel(), document.colorDepth(), document.colorProfile())
    map_of.waitForDone()
    layer = document.createNode(depth, "paintlayer")
    layer.setPixelData(map_of.rootNode().projectionPixelData(*size), *size)
    document.rootNode().addChildNode(layer, None)
    document.refreshProjection()
    document.waitForDone()
    try:
        bokehnet.render_document(document, options, command)
    except bokehnet.extension.BokehnetError as error:
        reports["error"] = str(error)
    reports["layers"] = [each.name() for each in document.rootNode().childNodes()]
    reports["visible"] = [each.visible() for each in document.rootNode().childNodes()]
    document.setBatchmode(True)
    document.exportImage(str(folder / "krita.png"), InfoObject())
    (folder / "summary.json").write_text(json.dumps(reports))
