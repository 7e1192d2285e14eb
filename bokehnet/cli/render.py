"""``bokehnet render``: bokeh from a picture and its depth or disparity."""

from pathlib import Path
from typing import Annotated

import typer

from bokehnet.cli import aperture_options as opening
from bokehnet.cli import light_options as light
from bokehnet.cli import map_options as scene
from bokehnet.cli import sequence_options as many
from bokehnet.cli.engine_option import DEFAULT_ENGINE, Engine
from bokehnet.cli.memory_option import MaxMemory, parse_bytes
from bokehnet.errors import ParameterError

__all__ = ["render"]


def render(
    image: Annotated[Path, typer.Argument(help="All-in-focus picture; EXR and HDR are read as linear.")],
    output: Annotated[
        Path, typer.Option("--output", "-o", help="Where the result goes; its extension picks the format.")
    ],
    disparity: scene.Disparity = None,
    depth: scene.Depth = None,
    channel: scene.Channel = None,
    depth_unit: scene.DepthUnit = None,
    invert: scene.Invert = False,
    disparity_range: scene.DisparityRange = None,
    blur: scene.Blur = None,
    focus: scene.FocusValue = None,
    focal_length: scene.FocalLength = None,
    f_number: scene.FNumber = None,
    focus_distance: scene.FocusDistance = None,
    sensor_width: scene.SensorWidth = None,
    focus_at: scene.FocusAt = None,
    focus_range: scene.FocusRange = None,
    resize_disparity: scene.ResizeDisparity = False,
    mixed_depth: scene.MixedDepth = "auto",
    refine_disparity: scene.RefineDisparity = "auto",
    engine: Engine = DEFAULT_ENGINE,
    blades: opening.Blades = 0,
    blade_curvature: opening.BladeCurvature = None,
    aperture_rotation: opening.ApertureRotation = None,
    squeeze: opening.Squeeze = 1.0,
    cats_eye: opening.CatsEye = 0.0,
    aperture_image: opening.ApertureImage = None,
    rim: opening.Rim = 0.0,
    obstruction: opening.Obstruction = 0.0,
    gamma: light.Gamma = 1.0,
    highlights: light.HighlightThreshold = None,
    highlight_gain: light.HighlightGain = None,
    frames: many.Frames = None,
    jobs: many.Jobs = None,
    overwrite: many.Overwrite = False,
    focus_from: many.FocusFrom = None,
    focus_to: many.FocusTo = None,
    f_number_from: many.FNumberFrom = None,
    f_number_to: many.FNumberTo = None,
    blur_from: many.BlurFrom = None,
    blur_to: many.BlurTo = None,
    pull: many.PullFile = None,
    save_maps: Annotated[
        Path | None, typer.Option(help="Folder for defocus, error map, classical and neural as pictures.")
    ] = None,
    weights: Annotated[Path | None, typer.Option(help="Folder with other networks.")] = None,
    max_memory: MaxMemory = None,
) -> None:
    """Render bokeh from an image and its depth or disparity."""
    from bokehnet.cli.compiling import compile_notice  # after parsing, so --help stays fast
    from bokehnet.cli.focus import Focus, parse_pixel, parse_range
    from bokehnet.cli.frames import is_pattern, parse_frames
    from bokehnet.cli.look import Look, Renderer
    from bokehnet.cli.progress import progress
    from bokehnet.cli.render_job import RenderJob, render_frame
    from bokehnet.cli.scene_map import MapSource
    from bokehnet.cli.sequence import jobs_of_frames, render_sequence

    source = MapSource(
        disparity=disparity,
        depth=depth,
        channel=channel,
        unit=depth_unit,
        invert=invert,
        value_range=None if disparity_range is None else parse_range(disparity_range, "--disparity-range"),
        mixed=mixed_depth,
        resize=resize_disparity,
        refine=refine_disparity,
    )
    focusing = Focus(
        focus_at=None if focus_at is None else parse_pixel(focus_at),
        focus_range=None if focus_range is None else parse_range(focus_range, "--focus-range"),
        focus=focus,
        focus_distance=focus_distance,
        blur=blur,
        focal_length=focal_length,
        f_number=f_number,
        sensor_width=sensor_width,
    )
    job = RenderJob(image=image, output=output, source=source, focus=focusing, save_maps=save_maps)
    blur_given = blur is not None or blur_from is not None
    ends = {
        "focus_distance" if source.is_metric(blur_given) else "focus": (focus_from, focus_to),
        "f_number": (f_number_from, f_number_to),
        "blur": (blur_from, blur_to),
    }
    expansion = light.make_highlights(highlights, highlight_gain)
    if frames is None:
        if jobs or overwrite or pull or any(value is not None for pair in ends.values() for value in pair):
            raise ParameterError(f"{_SEQUENCE_ONLY} need --frames")
        if is_pattern(image) and not image.exists():
            raise ParameterError(f"{image} names a sequence: say which frames, such as --frames 1001-1100")
        job.check()
        frame_jobs = {}
    else:
        numbers = parse_frames(frames)
        frame_jobs = jobs_of_frames(job, numbers, many.make_pull(numbers, ends, pull))
    aperture = opening.read_aperture(
        blades=blades,
        curvature=blade_curvature,
        rotation=aperture_rotation,
        squeeze=squeeze,
        cats_eye=cats_eye,
        image=aperture_image,
        rim=rim,
        obstruction=obstruction,
    )
    look = Look(
        engine=engine,
        aperture=aperture,
        weights=weights,
        gamma=gamma,
        highlights=expansion,
        max_memory=None if max_memory is None else parse_bytes(max_memory),
    )
    with compile_notice():
        if frame_jobs:
            render_sequence(frame_jobs, look, processes=jobs or 1, overwrite=overwrite)
        else:
            with progress("rendering") as report:
                render_frame(job, Renderer(look), report)


_SEQUENCE_ONLY = "--jobs, --overwrite, --pull and options that end in -from and -to"
