"""Runs in GIMP 3, in its python-fu-eval: a picture with a depth layer is rendered, and the outcome written.

BOKEHNET_TASK names the folder of the files; task.json in it has the program, its options and the depth
layer's name.
"""

import json
import os
from pathlib import Path

import gi

gi.require_version("Gimp", "3.0")
from gi.repository import Gimp, Gio  # noqa: E402


def main() -> None:
    folder = Path(os.environ["BOKEHNET_TASK"])
    command, options, depth = json.loads((folder / "task.json").read_text())
    quiet = Gimp.RunMode.NONINTERACTIVE
    image = Gimp.file_load(quiet, Gio.File.new_for_path(str(folder / "photo.png")))
    layer = Gimp.file_load_layer(quiet, image, Gio.File.new_for_path(str(folder / "disparity.png")))
    layer.set_name(depth)
    image.insert_layer(layer, None, 0)
    procedure = Gimp.get_pdb().lookup_procedure("plug-in-bokehnet")
    config = procedure.create_config()
    config.set_property("run-mode", quiet)
    config.set_property("image", image)
    config.set_core_object_array("drawables", [layer])
    config.set_property("command", command)
    config.set_property("options", options)
    values = procedure.run(config)
    status = values.index(0)
    reports = {"version": Gimp.version(), "status": status.value_nick}
    if status != Gimp.PDBStatusType.SUCCESS:
        reports["error"] = values.index(1)
    reports["layers"] = [each.get_name() for each in image.get_layers()]
    reports["visible"] = [each.get_visible() for each in image.get_layers()]
    Gimp.file_save(quiet, image, Gio.File.new_for_path(str(folder / "gimp.png")), None)
    (folder / "summary.json").write_text(json.dumps(reports))


main()
