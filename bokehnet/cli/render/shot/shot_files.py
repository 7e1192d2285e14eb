"""Frames of a sequence as one shot: decisions common to all frames are added to their jobs."""

import shutil
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

from bokehnet.cli.render.frame import FrameJob
from bokehnet.errors import BokehnetError
from bokehnet.progress import Progress
from bokehnet.render.renderer import BokehRenderer
from bokehnet.scene.depth.depth_source import DepthSource, NetworkDepth
from bokehnet.scene.scene import Scene, read_scene
from bokehnet.sequence.resumable_folder import claim_folder, exclusive_folder, file_signature
from bokehnet.sequence.sequence import input_files
from bokehnet.sequence.shot import Shot, analyse_shot, can_filter_maps, open_source, probe_frames
from bokehnet.settings.settings import RenderSettings
from bokehnet.version import __version__

__all__ = ["decided_jobs"]


@dataclass(frozen=True, slots=True)
class _Files:
    """Frames read from files; see :class:`bokehnet.sequence.shot.ShotFrames`."""

    jobs: Sequence[FrameJob]
    selected: frozenset[int]
    are_files = True

    @property
    def numbers(self) -> Sequence[int]:
        return [job.number for job in self.jobs]

    @property
    def probes(self) -> Sequence[int]:
        return [job.number for job in self.jobs if job.is_probe] or probe_frames(self.numbers)

    def settings_of(self, index: int) -> RenderSettings:
        return self.jobs[index].settings

    def scenes(self, indices: Sequence[int], shot: Shot) -> Iterator[Scene | None]:
        network: DepthSource | None = None
        for index in indices:
            job = self.jobs[index]
            try:
                source = shot.source(job.number, job.settings) or network or open_source(job.settings)
                network = source if isinstance(source, NetworkDepth) else None
                scene = read_scene(job.image, job.settings, source=source, number=job.number)
            except BokehnetError:  # raised again when the frame is rendered
                scene = None
            yield scene


@contextmanager
def decided_jobs(
    jobs: Mapping[int, FrameJob],
    renderer: BokehRenderer,
    *,
    context: Mapping[int, FrameJob] | None = None,
    steady: bool = True,
    begin: Callable[[str], Progress],
) -> Iterator[tuple[dict[int, FrameJob], Shot]]:
    """Yield the jobs with the decisions common to all frames of their shot, and those decisions.

    Smoothed maps are kept in a hidden folder next to the results until the block ends and all results exist.
    An interrupted run leaves them to the next run, unless files or settings change.

    Args:
        jobs: Frame number to job, all frames to render.
        context: Frame number to job, further frames of their shot to read; some may be in ``jobs`` too.
        renderer: Renderer made for their settings.
        steady: True to smooth relative maps along the motion of the shot.
        begin: Callback that begins a stage by its label and returns its progress callback.

    Raises:
        BokehnetError: The folder cannot be created or written.
    """
    read = {**jobs, **(context or {})}
    frames = [read[number] for number in sorted(read)]
    shot_frames = _Files(frames, frozenset(jobs))
    depth_files = {_depth_files(job) for job in frames}
    if len({(job.image, *_depth_files(job)) for job in frames}) < 2:  # a still: all frames decide equally
        yield dict(jobs), Shot()
        return
    model = frames[0].settings.input.depth_model is not None
    steady = steady and can_filter_maps(frames[0].settings, many=model or len(depth_files) > 1)
    if not steady:
        shot = analyse_shot(shot_frames, renderer, folder=None, steady=False, begin=begin)
        yield _with_shot(jobs, shot), shot
        return
    output = jobs[min(jobs)].output.absolute()
    with exclusive_folder(output.with_name(f".bokehnet-shot-{output.name}-{max(jobs)}")) as held:
        folder = held / "shot"
        claim_folder(folder, _fingerprint(frames))
        shot = analyse_shot(shot_frames, renderer, folder=folder, steady=True, begin=begin)
        yield _with_shot(jobs, shot), shot
        if all(job.output.exists() for job in jobs.values()):
            shutil.rmtree(held, ignore_errors=True)


def _with_shot(jobs: Mapping[int, FrameJob], shot: Shot) -> dict[int, FrameJob]:
    return {frame: replace(job, shot=shot.for_frame(frame)) for frame, job in jobs.items()}


def _depth_files(job: FrameJob) -> tuple[Path, ...]:
    return tuple(path for name, path in input_files(job.settings).items() if name != "matte")


def _fingerprint(frames: Sequence[FrameJob]) -> dict[str, object]:
    """Return everything that smoothed maps and their repair plan depend on."""
    files = [path for job in frames for path in (job.image, *input_files(job.settings).values())]
    settings = frames[0].settings.to_table()
    return {
        "frames": [job.number for job in frames],
        "settings": {group: settings.get(group) for group in ("depth", "input")},
        "files": [file_signature(path) if path.exists() else [str(path)] for path in dict.fromkeys(files)],
        "version": __version__,
    }
