"""Export of the document as a picture and a map, rendering by the command line, and import as a layer."""

import os
import shlex
import shutil
import subprocess
import tempfile

from krita import Extension, InfoObject, Krita
from PyQt5.QtWidgets import QInputDialog, QMessageBox

__all__ = ["BokehnetError", "BokehnetExtension", "render_document"]

DEPTH, RESULT = "depth", "bokeh"
GROUP, COMMAND, OPTIONS = "bokehnet", "bokehnet", ""


class BokehnetError(Exception):
    """One-line error with subject, expected, found and way out."""


def _export(document, path):
    information = InfoObject()
    information.setProperty("alpha", False)
    information.setProperty("compression", 1)
    document.setBatchmode(True)
    if not document.exportImage(path, information):
        raise BokehnetError(f"document: expected to be exported to {path}, found that Krita cannot")


def _export_visible(document, path, visible):
    """Export the document with only the selected top-level layers visible, and restore their visibility."""
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
    """Render all visible layers except the depth and an earlier result, and add the result as a layer.

    Args:
        document: Document with a layer named ``depth``, bright is near.
        options: Options of ``bokehnet render``.
        command: Program with its leading arguments.

    Raises:
        BokehnetError: There is no depth layer, or the program failed.
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
        _export_visible(document, picture, lambda layer, was: was and layer.name() not in (DEPTH, RESULT))
        _export_visible(document, depth, lambda layer, was: layer.name() == DEPTH)
        words = [*shlex.split(command), "render", picture, "--disparity", depth, "-o", result]
        try:
            done = subprocess.run(
                [*words, *shlex.split(options), "--quiet"],
                capture_output=True,
                text=True,
                check=False,
                env={**os.environ, "PYTHONSAFEPATH": "1"},  # no modules of the current folder
            )
        except OSError as error:
            raise BokehnetError(
                f"program: expected bokehnet, found {command} ({error.strerror}); set it"
            ) from error
        if done.returncode:
            raise BokehnetError((done.stderr.strip().splitlines() or ["bokehnet failed"])[-1])
        application = Krita.instance()
        quiet = application.batchmode()
        application.setBatchmode(True)  # suppresses dialogs about profiles
        rendered = application.openDocument(result)
        application.setBatchmode(quiet)
        for earlier in [layer for layer in document.rootNode().childNodes() if layer.name() == RESULT]:
            earlier.remove()
        layer = document.createNode(RESULT, "paintlayer")
        color_space = (document.colorModel(), document.colorDepth(), document.colorProfile())
        rendered.setColorSpace(*color_space)
        rendered.waitForDone()
        width, height = document.width(), document.height()
        layer.setPixelData(rendered.rootNode().projectionPixelData(0, 0, width, height), 0, 0, width, height)
        rendered.close()
        document.rootNode().addChildNode(layer, None)
        document.refreshProjection()
        document.waitForDone()


class BokehnetExtension(Extension):
    """Menu action of the plug-in."""

    def setup(self):
        """Do nothing before a window exists."""

    def createActions(self, window):  # noqa: N802, Krita's name
        """Add the action to the menu."""
        action = window.createAction("bokehnet_render", "Render bokeh", "tools/scripts")
        action.triggered.connect(self.render)

    def render(self):
        """Ask for options, render, and show an error as a message."""
        application = Krita.instance()
        options = application.readSetting(GROUP, "options", OPTIONS)
        question = "Options of bokehnet render; empty: focus on the subject"
        options, accepted = QInputDialog.getText(None, "bokehnet", question, text=options)
        if not accepted:
            return
        application.writeSetting(GROUP, "options", options)
        command = application.readSetting(GROUP, "command", COMMAND)
        if shutil.which(shlex.split(command)[0]) is None:
            question = "Program, such as /home/me/venv/bin/bokehnet"
            command, accepted = QInputDialog.getText(None, "bokehnet", question, text=command)
            if not accepted:
                return
            application.writeSetting(GROUP, "command", command)
        try:
            render_document(application.activeDocument(), options, command)
        except BokehnetError as error:
            QMessageBox.warning(None, "bokehnet", str(error))
