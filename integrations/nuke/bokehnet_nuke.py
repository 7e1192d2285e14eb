"""Not run in Nuke, which could not be had where the rest was tested: written against its published interface.

Renders the input's RGBA and depth.Z by the command line, a frame at a time, and reads the result back. Put
this folder on NUKE_PATH; ``menu.py`` adds **Filter > bokehnet**. What the panel holds are knobs of the gizmo
``bokehnet.gizmo``, named as ZDefocus names them; math ``depth`` means metres, ``far=0`` their inverse.
"""

import os
import shlex
import subprocess
import tempfile

__all__ = ["command_of", "render"]


def command_of(knobs, picture, output):
    """Return the words of the command line for one frame; free of Nuke, for tests.

    Args:
        knobs: Name to value, as the gizmo has them.
        picture: EXR with R, G, B, A and depth.Z.
        output: EXR of the result.
    """
    words = [*shlex.split(knobs["command"]), "render", picture, "-o", output]
    words += ["--depth", picture, "--channel", "depth.Z"]
    words += ["--depth-unit", "1/m" if knobs["math"] == "far=0" else "m"]
    distance = 1 / knobs["center"] if knobs["math"] == "far=0" else knobs["center"]
    words += ["--focus-distance", f"{distance:g}", "--focal-length", f"{knobs['focal']:g}"]
    words += ["--f-number", f"{knobs['fstop']:g}", "--sensor-width", f"{knobs['haperture']:g}"]
    if knobs["filter_type"] == "bladed":
        words += ["--blades", str(int(knobs["blades"])), "--blade-curvature", f"{knobs['roundness']:g}"]
        words += ["--aperture-rotation", f"{knobs['rotation']:g}"]
    if knobs["aspect"] != 1:
        words += ["--squeeze", f"{knobs['aspect']:g}"]
    return [*words, "--quiet"]


def render(gizmo, frames):
    """Render frames of the gizmo's input into its folder; what is wrong is a message of Nuke."""
    import nuke

    names = [
        "command",
        "math",
        "center",
        "focal",
        "fstop",
        "haperture",
        "filter_type",
        "blades",
        "roundness",
        "rotation",
        "aspect",
    ]
    knobs = {name: gizmo[name].value() for name in names}
    folder = gizmo["folder"].value() or os.path.join(tempfile.gettempdir(), "bokehnet")
    os.makedirs(folder, exist_ok=True)
    writer = gizmo.node("pinhole")
    writer["file"].setValue(os.path.join(folder, "pinhole.%04d.exr").replace("\\", "/"))
    progress = nuke.ProgressTask("bokehnet")
    for place, frame in enumerate(frames):
        if progress.isCancelled():
            return
        progress.setProgress(int(100 * place / len(frames)))
        nuke.execute(writer, frame, frame)
        picture = os.path.join(folder, f"pinhole.{frame:04d}.exr")
        output = os.path.join(folder, f"bokeh.{frame:04d}.exr")
        done = subprocess.run(command_of(knobs, picture, output), capture_output=True, text=True, check=False)
        if done.returncode:
            nuke.message(f"frame {frame}: {done.stderr.strip()}")
            return
    gizmo.node("result")["file"].setValue(os.path.join(folder, "bokeh.%04d.exr").replace("\\", "/"))
