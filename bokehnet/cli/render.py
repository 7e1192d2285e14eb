"""``bokehnet render``: bokeh from a picture and its depth or disparity."""

from pathlib import Path
from typing import Annotated

import typer

from bokehnet.cli import aperture_options as opening
from bokehnet.cli import character_options as glass
from bokehnet.cli import effect_options as camera
from bokehnet.cli import focus_plane_options as leaning
from bokehnet.cli import fringe_options as colors
from bokehnet.cli import light_options as light
from bokehnet.cli import map_options as scene
from bokehnet.cli import sequence_options as many
from bokehnet.cli.engine_option import DEFAULT_ENGINE, Engine
from bokehnet.cli.memory_option import MaxMemory, parse_bytes
from bokehnet.cli.preset_option import PresetName
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
    focus_plane: leaning.FocusPlane = None,
    tilt_x: leaning.TiltX = 0.0,
    tilt_y: leaning.TiltY = 0.0,
    resize_disparity: scene.ResizeDisparity = False,
    mixed_depth: scene.MixedDepth = "auto",
    refine_disparity: scene.RefineDisparity = "auto",
    engine: Engine = DEFAULT_ENGINE,
    preset: PresetName = None,
    blades: opening.Blades = 0,
    blade_curvature: opening.BladeCurvature = None,
    aperture_rotation: opening.ApertureRotation = None,
    squeeze: opening.Squeeze = 1.0,
    cats_eye: opening.CatsEye = 0.0,
    aperture_image: opening.ApertureImage = None,
    rim: opening.Rim = 0.0,
    obstruction: opening.Obstruction = 0.0,
    onion: opening.Onion = 0.0,
    onion_rings: opening.OnionRings = None,
    disc_grain: opening.DiscGrain = 0.0,
    disc_grain_seed: opening.DiscGrainSeed = None,
    gamma: light.Gamma = 1.0,
    highlights: light.HighlightThreshold = None,
    highlight_gain: light.HighlightGain = None,
    lens: glass.LensName = None,
    aberrations: glass.Aberrations = None,
    lens_f_number: glass.LensFNumber = None,
    lens_distortion: glass.LensDistortion = False,
    spherical: glass.Spherical = 0.0,
    coma: glass.Coma = 0.0,
    astigmatism: glass.Astigmatism = 0.0,
    field_curvature: glass.FieldCurvature = 0.0,
    axial_fringe: colors.AxialFringe = 0.0,
    lateral_fringe: colors.LateralFringe = 0.0,
    axial_map: colors.AxialMap = None,
    lateral_map: colors.LateralMap = None,
    fringe_glass: colors.FringeGlass = None,
    dispersion: colors.Dispersion = None,
    equaliser: colors.Equaliser = None,
    distortion: camera.DistortionStrength = 0.0,
    distortion_brown: camera.DistortionBrown = None,
    cos4: camera.Cos4 = 0.0,
    optical_vignetting: camera.OpticalVignetting = 0.0,
    vignette: camera.VignetteStops = None,
    vignette_radius: camera.VignetteRadius = None,
    vignette_softness: camera.VignetteSoftness = None,
    vignette_roundness: camera.VignetteRoundness = None,
    grain: camera.GrainIso = None,
    grain_size: camera.GrainSize = None,
    grain_mono: camera.GrainMono = False,
    grain_seed: camera.GrainSeed = None,
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
    from bokehnet.cli.focus import Focus, parse_pixel, parse_plane, parse_range
    from bokehnet.cli.frames import is_pattern, parse_frames
    from bokehnet.cli.look import Look, Renderer
    from bokehnet.cli.progress import progress
    from bokehnet.cli.render_job import RenderJob, render_frame
    from bokehnet.cli.scene_map import MapSource
    from bokehnet.cli.sequence import jobs_of_frames, render_sequence
    from bokehnet.optics.lens_response import LensResponse

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
        focus_plane=None if focus_plane is None else parse_plane(focus_plane),
        tilt=(tilt_x, tilt_y),
    )
    prescription = glass.choose_lens(
        lens, aberrations=aberrations, distortion=lens_distortion, f_number=lens_f_number
    )
    job = RenderJob(
        image=image, output=output, source=source, focus=focusing, save_maps=save_maps, lens=prescription
    )
    blur_given = blur is not None or blur_from is not None
    ends = {
        "focus_distance" if source.is_metric(blur_given) else "focus": (focus_from, focus_to),
        "f_number": (f_number_from, f_number_to),
        "blur": (blur_from, blur_to),
    }
    expansion = light.make_highlights(highlights, highlight_gain)
    effects = camera.make_effects(
        distortion=distortion,
        brown=distortion_brown,
        cos4=cos4,
        optical_vignetting=optical_vignetting,
        vignette=vignette,
        radius=vignette_radius,
        softness=vignette_softness,
        roundness=vignette_roundness,
        iso=grain,
        size=grain_size,
        mono=grain_mono,
        seed=grain_seed,
    )
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
        onion=onion,
        onion_rings=onion_rings,
        grain=disc_grain,
        grain_seed=disc_grain_seed,
    )
    character = glass.make_character(
        engine=engine,
        lens=prescription,
        spherical=spherical,
        coma=coma,
        astigmatism=astigmatism,
        field_curvature=field_curvature,
        fringes=colors.make_fringes(
            axial=axial_fringe,
            lateral=lateral_fringe,
            axial_map=axial_map,
            lateral_map=lateral_map,
            glass=fringe_glass,
        ),
        light=colors.make_light(dispersion, equaliser),
    )
    look = Look(
        engine=engine,
        aperture=aperture,
        character=character or LensResponse(),
        weights=weights,
        gamma=gamma,
        highlights=expansion,
        effects=effects,
        max_memory=None if max_memory is None else parse_bytes(max_memory),
    )
    with compile_notice():
        if frame_jobs:
            render_sequence(frame_jobs, look, processes=jobs or 1, overwrite=overwrite)
        else:
            with progress("rendering") as report:
                render_frame(job, Renderer(look), report)


_SEQUENCE_ONLY = "--jobs, --overwrite, --pull and options that end in -from and -to"
