"""The frames of a sequence as one shot: what is decided once for them goes into their jobs."""

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
from bokehnet.sequence.resumable_folder import claim_folder, own_folder, stamp
from bokehnet.sequence.sequence import input_files
from bokehnet.sequence.shot import Shot, decide_shot, gets_steady, open_source
from bokehnet.settings.settings import RenderSettings
from bokehnet.version import __version__

__all__ = ["decided_jobs"]


@dataclass(frozen=True, slots=True)
class _Files:
    """Frames that are read from files; see :class:`bokehnet.sequence.shot.ShotFrames`."""

    jobs: Sequence[FrameJob]

    @property
    def count(self) -> int:
        return len(self.jobs)

    def settings_of(self, index: int) -> RenderSettings:
        return self.jobs[index].settings

    def scenes(self, wanted: Sequence[int], shot: Shot) -> Iterator[Scene | None]:
        network: DepthSource | None = None
        for index in wanted:
            job = self.jobs[index]
            try:
                source = shot.source(index, job.settings) or network or open_source(job.settings)
                network = source if isinstance(source, NetworkDepth) else None
                scene = read_scene(job.image, job.settings, source=source, number=job.number)
            except BokehnetError:  # which is told when the frame is rendered
                scene = None
            yield scene


@contextmanager
def decided_jobs(
    jobs: Mapping[int, FrameJob],
    renderer: BokehRenderer,
    *,
    steady: bool = True,
    begin: Callable[[str], Progress],
) -> Iterator[tuple[dict[int, FrameJob], Shot]]:
    """Give jobs that know what was decided once for all frames of their shot, and what that is.

    Steady maps lie in a hidden folder beside the results, until the block ends and all results are there.
    A run that is stopped leaves them to the next one, unless files or settings have changed.

    Args:
        jobs: By frame, all of the shot.
        renderer: Fit for their settings.
        steady: Whether relative maps are made steady along the motion of the shot.
        begin: Is told of every stage; gives what its progress is reported to.

    Raises:
        BokehnetError: The folder cannot be made or written.
    """
    frames = list(jobs.values())
    own = {_depth_files(job) for job in frames}
    if len({(job.image, *_depth_files(job)) for job in frames}) < 2:  # a still: its frames decide alike
        yield dict(jobs), Shot()
        return
    model = frames[0].settings.input.depth_model is not None
    steady = steady and gets_steady(frames[0].settings, many=model or len(own) > 1)
    if not steady:
        shot = decide_shot(_Files(frames), renderer, folder=None, steady=False, begin=begin)
        yield _with_shot(jobs, shot), shot
        return
    output = frames[0].output.absolute()
    with own_folder(output.with_name(f".bokehnet-shot-{output.name}-{frames[-1].number}")) as held:
        folder = held / "shot"
        claim_folder(folder, _told(frames))
        shot = decide_shot(_Files(frames), renderer, folder=folder, steady=True, begin=begin)
        yield _with_shot(jobs, shot), shot
        if all(job.output.exists() for job in frames):
            shutil.rmtree(held, ignore_errors=True)


def _with_shot(jobs: Mapping[int, FrameJob], shot: Shot) -> dict[int, FrameJob]:
    return {frame: replace(job, shot=shot, index=index) for index, (frame, job) in enumerate(jobs.items())}


def _depth_files(job: FrameJob) -> tuple[Path, ...]:
    return tuple(path for name, path in input_files(job.settings).items() if name != "matte")


def _told(frames: Sequence[FrameJob]) -> dict[str, object]:
    """All that steady maps and the plan of their repair depend on."""
    files = [path for job in frames for path in (job.image, *input_files(job.settings).values())]
    told = frames[0].settings.to_table()
    return {
        "frames": [job.number for job in frames],
        "settings": {group: told.get(group) for group in ("depth", "input")},
        "files": [stamp(path) if path.exists() else [str(path)] for path in dict.fromkeys(files)],
        "version": __version__,
    }
