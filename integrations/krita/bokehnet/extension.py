"""The document as a picture and a map in files, the command line on them, and the result as a layer."""

import os
import shlex
import subprocess
import tempfile

from krita import Extension, InfoObject, Krita
from PyQt5.QtWidgets import QInputDialog, QMessageBox

__all__ = ["BokehnetError", "BokehnetExtension", "render_document"]

DEPTH, RESULT = "depth", "bokeh"
GROUP, COMMAND, OPTIONS = "bokehnet", "bokehnet", "--blur 40 --focus 0.5"


class BokehnetError(Exception):
    """One line with what, expected, found and the way out."""


def _export(document, path):
    information = InfoObject()
    information.setProperty("alpha", False)
    information.setProperty("compression", 1)
    document.setBatchmode(True)
    if not document.exportImage(path, information):
        raise BokehnetError(f"document: expected to be exported to {path}, found that Krita cannot")


def _shown(document, path, visible):
    """Export the document with some layers of its top level visible alone, and put all back."""
    layers = document.rootNode().childNodes()
    before = [(layer, layer.visible()) for layer in layers]
    try:
        for layer, was in before:
            layer.setVisible(visible(layer, was))
        document.refreshProjection()
        document.waitForDone()
        _export(document, path)
    finally:
        for layer, was in before:
            layer.setVisible(was)
        document.refreshProjection()
        document.waitForDone()


def render_document(document, options=OPTIONS, command=COMMAND):
    """Render all visible layers but the depth and an earlier result, and add the result as a layer.

    Args:
        document: With a layer named ``depth``, near is bright.
        options: Of ``bokehnet render``.
        command: Words of the program.

    Raises:
        BokehnetError: There is no depth, or the program said no.
    """
    if document is None:
        raise BokehnetError("document: expected an open one, found none; open a picture")
    names = [layer.name() for layer in document.rootNode().childNodes()]
    if DEPTH not in names:
        raise BokehnetError(
            f"layers: expected one named {DEPTH}, found {', '.join(names)}; name the depth so"
        )
    with tempfile.TemporaryDirectory() as folder:
        picture, depth, result = (os.path.join(folder, f"{name}.png") for name in ("picture", DEPTH, RESULT))
        _shown(document, picture, lambda layer, was: was and layer.name() not in (DEPTH, RESULT))
        _shown(document, depth, lambda layer, was: layer.name() == DEPTH)
        words = [*shlex.split(command), "render", picture, "--disparity", depth, "-o", result]
        try:
            done = subprocess.run(
                [*words, *shlex.split(options), "--quiet"], capture_output=True, text=True, check=False
            )
        except OSError as error:
            raise BokehnetError(
                f"program: expected bokehnet, found {command} ({error.strerror}); set it"
            ) from error
        if done.returncode:
            raise BokehnetError((done.stderr.strip().splitlines() or ["bokehnet failed"])[-1])
        application = Krita.instance()
        quiet = application.batchmode()
        application.setBatchmode(True)  # no questions about profiles
        made = application.openDocument(result)
        application.setBatchmode(quiet)
        for earlier in [layer for layer in document.rootNode().childNodes() if layer.name() == RESULT]:
            earlier.remove()
        layer = document.createNode(RESULT, "paintlayer")
        same = (document.colorModel(), document.colorDepth(), document.colorProfile())
        made.setColorSpace(*same)
        made.waitForDone()
        width, height = document.width(), document.height()
        layer.setPixelData(made.rootNode().projectionPixelData(0, 0, width, height), 0, 0, width, height)
        made.close()
        document.rootNode().addChildNode(layer, None)
        document.refreshProjection()
        document.waitForDone()


class BokehnetExtension(Extension):
    """The action in the menu."""

    def setup(self):
        """Nothing before there is a window."""

    def createActions(self, window):  # noqa: N802, as Krita calls it
        """Add the action."""
        action = window.createAction("bokehnet_render", "Render bokeh", "tools/scripts")
        action.triggered.connect(self.render)

    def render(self):
        """Ask for options, render, and tell what is wrong in a message."""
        application = Krita.instance()
        options = application.readSetting(GROUP, "options", OPTIONS)
        options, wanted = QInputDialog.getText(None, "bokehnet", "Options of bokehnet render", text=options)
        if not wanted:
            return
        application.writeSetting(GROUP, "options", options)
        command = application.readSetting(GROUP, "command", COMMAND)
        try:
            render_document(application.activeDocument(), options, command)
        except BokehnetError as error:
            QMessageBox.warning(None, "bokehnet", str(error))
