"""Checks of a job before anything slow: consistent settings, readable inputs, a writable output.

Only headers are read, and no kernels are imported, so that mistakes are reported within half a second.
"""

from collections.abc import Iterable
from pathlib import Path

from bokehnet.engine_registry import DEFAULT_ENGINE, ENGINES
from bokehnet.errors import ErrorCollector, ImageFileError, ParameterError
from bokehnet.io.containers.input_checks import check_intact
from bokehnet.io.files.atomic import folder_problem
from bokehnet.io.formats.heif import heif_size, is_heif
from bokehnet.io.formats.whole_picture import WHOLE_EXTENSIONS
from bokehnet.io.image import check_writable
from bokehnet.io.metadata.camera import Camera, camera_from_exif, camera_from_exr
from bokehnet.io.pixels import ImageFile
from bokehnet.io.selection.picture import find_picture
from bokehnet.io.window import Window
from bokehnet.render.output import check_output
from bokehnet.scene.depth.depth_source import EmbeddedDepth, depth_source
from bokehnet.scene.depth.map_checks import check_map_file
from bokehnet.scene.focus_checks import check_focus, check_pixels
from bokehnet.sequence.sequence import input_files
from bokehnet.settings.settings import EngineSettings, RenderSettings

__all__ = ["check_inputs", "check_job", "picture_header"]

# Formats that compress with loss.
_LOSSY = (".jpg", ".jpeg", ".webp", ".hdr", ".avif", ".heic", ".heif")


def check_job(image: Path, output: Path, settings: RenderSettings) -> None:
    """Raise unless the settings are consistent and the result can be written; reads no pixels.

    Args:
        image: File of the picture.
        output: File of the result.
        settings: Settings of the render.

    Raises:
        ParameterError: All contradictory and missing settings, in one message.
        MissingExtraError: The device needs packages that are not installed.
        ImageFileError: The output cannot be written.
    """
    errors = ErrorCollector()
    with errors.collect():
        check_focus(settings)
    with errors.collect():
        _check_device(settings.engine)
    check_writable(output)
    with errors.collect():
        check_output(output, settings.output)
    with errors.collect():
        if settings.engine.max_memory is not None and output.suffix.lower() in WHOLE_EXTENSIONS:
            raise ParameterError(
                "engine.max_memory",
                "no limit for AVIF and HEIC, whose encoders need the whole picture",
                settings.engine.max_memory,
                "leave it out, or write .jpg, .png or .tif",
            )
    with errors.collect():
        try:
            inputs, is_reduced = input_files(settings).values(), settings.input.supersampled > 1
            _check_overwrite(output, image, inputs, reduced=is_reduced)
        except ParameterError as error:
            raise error.renamed("--output") from error
    errors.raise_all()
    _check_maps_folder(settings.output.save_maps)


def _check_overwrite(output: Path, picture: Path, others: Iterable[Path], *, reduced: bool = False) -> None:
    """Raise unless the result may be written at ``output``; only headers are read.

    Args:
        output: File to write.
        picture: File of the picture. An EXR may be overwritten, since everything else in the file is kept;
            PNG and TIFF if they have 8 bits, like the output.
        others: All other input files, such as maps.
        reduced: True if the result is smaller than the picture.

    Raises:
        ParameterError: ``output`` is an input that must not be overwritten.
    """
    if not output.exists():
        return
    if any(_is_same_file(output, other) for other in others) and not _is_same_file(output, picture):
        raise _overwrite_error(output, "is read for this picture")
    if not _is_same_file(output, picture):
        return
    if output.suffix.lower() in _LOSSY:
        raise _overwrite_error(output, "is the picture itself, which would be compressed with loss once more")
    if reduced:
        raise _overwrite_error(output, "is the picture itself, which is larger")
    try:
        with ImageFile(picture) as file:
            deep = find_picture(file).part.deep
            wide = file.headers is None and any(name != "uint8" for name in file.parts[0].formats)
            other = file.headers is None and output.suffix.lower() == ".exr"
    except ImageFileError:  # reported when the picture is read
        return
    if deep or wide or other:
        content = "deep samples" if deep else "another format" if other else "more than 8 bits per channel"
        raise _overwrite_error(output, f"is the picture itself, which holds {content}")


def _is_same_file(one: Path, other: Path) -> bool:
    return other.exists() and one.samefile(other)


def _overwrite_error(output: Path, reason: str) -> ParameterError:
    return ParameterError("output", f"another name: {output} {reason}", remedy="write to a new file")


def _check_device(engine: EngineSettings) -> None:
    """Raise ``ParameterError`` if the settings ask for a CUDA device that this machine lacks."""
    if engine.device != "cuda":
        return  # the others always exist, and this check imports torch
    from bokehnet.engines.devices import device_of

    name = engine.name or DEFAULT_ENGINE
    device_of("cuda", ENGINES[name].classical if name in ENGINES else name)


def _check_maps_folder(folder: Path | None) -> None:
    if folder is None:
        return
    nearest = next(path for path in (folder, *folder.absolute().parents) if path.exists())
    if not nearest.is_dir():
        raise ImageFileError(f"`output.save_maps`: expected a folder, found the file {nearest}")
    if problem := folder_problem(nearest):
        raise ImageFileError(f"`output.save_maps`: {problem}")


def check_inputs(image: Path, settings: RenderSettings) -> Window:
    """Return the size of a picture; raise unless its files can be opened and the settings apply to them.

    Args:
        image: File of the picture.
        settings: Settings of the render.

    Raises:
        ImageFileError: A file is missing or damaged, or the map is none.
        ShapeError: The map has another size than the picture.
        ParameterError: A pixel in focus lies outside the picture, or a setting does not apply to the map.
        LensError, ConfigError: As :func:`bokehnet.scene.prescription.prescription_lens`.
    """
    window = picture_header(image)[0]
    for name, path in input_files(settings).items():
        if name != "depth_model":
            check_intact(path)
    source = depth_source(settings)
    if not isinstance(source, EmbeddedDepth):  # a phone's original may have another size
        check_pixels(settings.focus, window, settings.input.supersampled)
    check_map_file(source, window, may_resize=settings.depth.resize)
    if settings.lens.name is not None:
        from bokehnet.scene.prescription import prescription_lens  # imports numba, 0.2 s

        prescription_lens(settings.lens)
    return window


def picture_header(path: Path) -> tuple[Window, Camera | None]:
    """Return size and camera of a picture; reads no pixels.

    Raises:
        ImageFileError: The file is missing, damaged or no picture.
    """
    if is_heif(path):
        height, width = heif_size(path)
        return Window.whole(width, height), None
    with ImageFile(path) as file:
        part = find_picture(file).part
        attributes = file.attributes(part)
        if file.headers is not None:
            return part.window, camera_from_exr(attributes)
        height, width = part.upright_size
        return Window.whole(width, height), camera_from_exif(attributes, width, height)
