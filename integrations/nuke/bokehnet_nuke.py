"""Nuke gizmo for bokehnet. Untested in Nuke, which was unavailable: written against its published interface.

Renders the input's RGBA and depth.Z with the command line, frame by frame, and reads the result back. Put
this folder on NUKE_PATH; ``menu.py`` adds **Filter > bokehnet**. The panel contains the knobs of the gizmo
``bokehnet.gizmo``, named as in ZDefocus; math ``depth`` means metres, ``far=0`` their inverse.
"""

import os
import shlex
import subprocess
import tempfile

__all__ = ["command_line", "render"]


def command_line(knobs, picture, output):
    """Return the arguments of the command line for one frame; independent of Nuke.

    Args:
        knobs: Values of the gizmo's knobs by name.
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
    """Render frames of the gizmo's input into its folder; show errors as messages of Nuke."""
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
    for index, frame in enumerate(frames):
        if progress.isCancelled():
            return
        progress.setProgress(int(100 * index / len(frames)))
        nuke.execute(writer, frame, frame)
        picture = os.path.join(folder, f"pinhole.{frame:04d}.exr")
        output = os.path.join(folder, f"bokeh.{frame:04d}.exr")
        done = subprocess.run(
            command_line(knobs, picture, output),
            capture_output=True,
            text=True,
            check=False,
            env={**os.environ, "PYTHONSAFEPATH": "1"},  # no modules of the current folder
        )
        if done.returncode:
            nuke.message(f"frame {frame}: {done.stderr.strip()}")
            return
    gizmo.node("result")["file"].setValue(os.path.join(folder, "bokeh.%04d.exr").replace("\\", "/"))
