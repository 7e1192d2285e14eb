"""One frame: what it is made of, and its rendering."""

import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from bokehnet.cli.focus import Focus
from bokehnet.cli.look import Renderer
from bokehnet.cli.scene_map import MapSource
from bokehnet.cli.scene_reader import read_scene
from bokehnet.errors import ImageFileError

if TYPE_CHECKING:
    import numpy as np

    from bokehnet.cli.character_options import ChosenLens
    from bokehnet.cli.scene_map import SceneMap
    from bokehnet.inference.pipeline import RenderResult
    from bokehnet.optics.aberration_map import AberrationMap

__all__ = ["RenderJob", "check_folder", "render_frame"]


@dataclass(frozen=True, kw_only=True, slots=True)
class RenderJob:
    """One frame to render.

    Attributes:
        image: The all-in-focus picture.
        output: Where the result goes.
        source: Where its map comes from.
        focus: What stays sharp, and how strongly the rest is blurred.
        save_maps: Folder for what the result is made of, before the effects of the camera.
        number: Of the frame in its sequence.
        lens: Prescription to render through.
    """

    image: Path
    output: Path
    source: MapSource
    focus: Focus
    save_maps: Path | None = None
    number: int = 0
    lens: "ChosenLens | None" = None

    def pencil(self, scene: "SceneMap") -> "AberrationMap | None":
        """Return what the lens and a leaning plane of focus do to the rays of this picture, if anything.

        Raises:
            BokehnetError: As :meth:`Focus.defocus` and :meth:`ChosenLens.pencil`.
        """
        leaning = self.focus.pencil(scene)
        if self.lens is None:
            return leaning
        pencil = self.lens.pencil(self.focus, scene)
        return pencil if leaning is None else pencil + leaning

    def check(self) -> None:
        """Raise unless the options fit together and the result can be written; no picture is read."""
        from bokehnet.io.image import check_writable

        self.source.check(self.focus)
        check_writable(self.output)
        if self.save_maps is not None:
            check_folder(self.save_maps)


def render_frame(
    job: RenderJob, renderer: Renderer, report: Callable[[int, int], None] | None = None
) -> None:
    """Read, render and write one frame; the output appears complete or not at all.

    Raises:
        BokehnetError: A file cannot be read or written, or numbers and files do not fit together.
    """
    from bokehnet.io.frame import write_frame

    frame, scene = read_scene(job.image, job.source, job.focus.blur is not None, renderer)
    defocus = job.focus.defocus(scene)
    pencil = job.pencil(scene)
    del scene
    alpha = frame.alpha
    if alpha is not None:
        alpha = renderer.render_alpha(alpha, defocus, pencil=pencil, taken=frame.image.nbytes)
    if job.save_maps is not None:
        defocus.flags.writeable = False  # the error map is not to take its place
    taken = (0 if frame.alpha is None else 2) * defocus.nbytes
    result = renderer.render(frame.image, defocus, report, pencil=pencil, taken=taken)
    if job.save_maps is not None:
        _save_maps(job.save_maps, result, defocus)
    del defocus
    bokeh, alpha = renderer.take(result.bokeh, alpha, frame.window, job.number)
    write_frame(job.output, frame, bokeh, alpha)


def check_folder(folder: Path) -> None:
    """Raise ``ImageFileError`` unless ``folder`` is there, or could be made; nothing is touched."""
    nearest = next(path for path in (folder, *folder.absolute().parents) if path.exists())
    if not nearest.is_dir():
        raise ImageFileError(f"--save-maps: expected a folder, found the file {nearest}")
    if not os.access(nearest, os.W_OK | os.X_OK):
        raise ImageFileError(f"--save-maps: the folder {nearest} is not writable")


def _save_maps(folder: Path, result: "RenderResult", defocus: "np.ndarray") -> None:
    """Write what the result was made of; defocus as a grey picture, 0.5 = sharp, and exact as EXR."""
    import numpy as np

    from bokehnet.io.image import write_image, write_map

    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ImageFileError(f"cannot make the folder {folder}: {error.strerror}") from error
    largest = max(float(np.abs(defocus).max()), 1e-6)
    write_map(folder / "defocus.exr", defocus)
    write_map(folder / "defocus.png", 0.5 + 0.5 * defocus / largest)
    write_map(folder / "error_map.png", result.error_map)
    if result.classical is not None:
        write_image(folder / "classical.png", result.classical)
    if result.neural is not None:
        write_image(folder / "neural.png", result.neural)
