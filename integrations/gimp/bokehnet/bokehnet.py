#!/usr/bin/env python3
"""GIMP 3 plug-in: the blur of a real lens, from a layer with the depth. Tested in GIMP 3.0.4.

Copy the folder ``bokehnet`` with this executable file into GIMP's folder ``plug-ins``. **Filters > Blur >
bokehnet** renders the visible image with the depth in its layer named *depth*, bright is near, and adds the
result as a layer *bokeh*.
"""

import os
import shlex
import subprocess
import sys
import tempfile

import gi

gi.require_version("Gimp", "3.0")
from gi.repository import Gimp, Gio, GLib, GObject  # noqa: E402

PROCEDURE, DEPTH, RESULT = "plug-in-bokehnet", "depth", "bokeh"


def export_layers(image, path, selected):
    """Write the image with only the layers for which ``selected`` returns true."""
    copy = image.duplicate()
    try:
        for layer in copy.get_layers():
            layer.set_visible(selected(layer))
        copy.merge_visible_layers(Gimp.MergeType.CLIP_TO_IMAGE)
        Gimp.file_save(Gimp.RunMode.NONINTERACTIVE, copy, Gio.File.new_for_path(path), None)
    finally:
        copy.delete()


def render_layer(image, command, options):
    """Add the result as a layer; return None, or a one-line error."""
    layers = image.get_layers()
    names = [layer.get_name() for layer in layers]
    if DEPTH not in names:
        return f"layers: expected one named {DEPTH}, found {', '.join(names)}; name the depth so"
    with tempfile.TemporaryDirectory() as folder:
        picture, depth, result = (os.path.join(folder, f"{name}.png") for name in ("picture", DEPTH, RESULT))
        export_layers(
            image, picture, lambda layer: layer.get_visible() and layer.get_name() not in (DEPTH, RESULT)
        )
        export_layers(image, depth, lambda layer: layer.get_name() == DEPTH)
        words = [*shlex.split(command), "render", picture, "--disparity", depth, "-o", result]
        try:
            words += [*shlex.split(options), "--quiet"]
            environment = {**os.environ, "PYTHONSAFEPATH": "1"}  # no modules of the current folder
            done = subprocess.run(words, capture_output=True, text=True, check=False, env=environment)
        except (OSError, ValueError) as error:
            return f"program: expected bokehnet and its options, found {command} ({error}); set them"
        if done.returncode:
            return (done.stderr.strip().splitlines() or ["bokehnet failed"])[-1]
        file = Gio.File.new_for_path(result)
        new_layer = Gimp.file_load_layer(Gimp.RunMode.NONINTERACTIVE, image, file)
        new_layer.set_name(RESULT)
        image.undo_group_start()
        for layer in layers:
            if layer.get_name() == RESULT:
                image.remove_layer(layer)
        image.insert_layer(new_layer, None, 0)
        image.undo_group_end()
    return None


class Bokehnet(Gimp.PlugIn):
    """Plug-in class."""

    def do_query_procedures(self):
        """Return the names of its procedures."""
        return [PROCEDURE]

    def do_create_procedure(self, name):
        """Return the procedure with its arguments and menu entry."""
        procedure = Gimp.ImageProcedure.new(self, name, Gimp.PDBProcType.PLUGIN, self.run, None)
        procedure.set_image_types("RGB*")
        procedure.set_menu_label("bokehnet...")
        procedure.add_menu_path("<Image>/Filters/Blur")
        procedure.set_documentation("The blur of a real lens", "Depth: the layer named depth", name)
        flags = GObject.ParamFlags.READWRITE
        procedure.add_string_argument("command", "Program", "Command line of bokehnet", "bokehnet", flags)
        about = "Options of bokehnet render; empty: focus on the subject"
        procedure.add_string_argument("options", "Options", about, "", flags)
        return procedure

    def run(self, procedure, mode, image, drawables, config, data):
        """Show a dialog if interactive, render, and return GIMP's status."""
        if mode == Gimp.RunMode.INTERACTIVE:
            gi.require_version("GimpUi", "3.0")
            from gi.repository import GimpUi

            GimpUi.init("bokehnet")
            dialog = GimpUi.ProcedureDialog.new(procedure, config, "bokehnet")
            dialog.fill(None)
            if not dialog.run():
                return procedure.new_return_values(Gimp.PDBStatusType.CANCEL, None)
            dialog.destroy()
        message = render_layer(image, config.get_property("command"), config.get_property("options"))
        if message is not None:
            error = GLib.Error.new_literal(GLib.quark_from_string(PROCEDURE), message, 0)
            return procedure.new_return_values(Gimp.PDBStatusType.EXECUTION_ERROR, error)
        Gimp.displays_flush()
        return procedure.new_return_values(Gimp.PDBStatusType.SUCCESS, None)


Gimp.main(Bokehnet.__gtype__, sys.argv)
