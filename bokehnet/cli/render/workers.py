"""Many frames, by one process or by several, each of which may fail without the others."""

import contextlib
import multiprocessing
import os
import signal
import sys
import traceback
from collections import deque
from collections.abc import Callable, Generator, Iterator, Mapping
from contextlib import ExitStack, closing
from multiprocessing import resource_tracker
from multiprocessing.connection import Connection, wait
from multiprocessing.context import SpawnProcess
from time import perf_counter

import numba
import OpenImageIO as oiio  # noqa: N813

from bokehnet.cli.options import told
from bokehnet.cli.progress import compile_notice, progress, stages, write_above
from bokehnet.cli.render.frame import FrameJob, make_renderer, render_frame
from bokehnet.cli.render.shot_files import decided_jobs
from bokehnet.cli.render.summary import FrameSummary, Talk
from bokehnet.errors import BokehnetError
from bokehnet.render.renderer import BokehRenderer
from bokehnet.sequence.frame_names import format_frames
from bokehnet.sequence.shot import Shot
from bokehnet.settings.settings import RenderSettings

__all__ = ["available_cores", "render_frames", "render_in_processes", "try_frame"]

# Each frame when it is done, with what was done or why it failed.
Outcomes = Generator[tuple[int, FrameSummary | str], None, None]


def available_cores() -> int:
    """Number of cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def render_frames(
    jobs: Mapping[int, FrameJob],
    *,
    processes: int = 1,
    elsewhere: Callable[[Mapping[int, FrameJob], RenderSettings], Outcomes] | None = None,
    overwrite: bool = False,
    steady: bool = True,
    talk: Talk | None = None,
) -> None:
    """Render the frames that are not there yet; files are written in one step, so what is there is complete.

    A frame that fails is told on stderr and does not stop the others.

    Args:
        jobs: By frame.
        processes: How many render at a time, with their share of the cores each.
        elsewhere: Renders jobs by frame in place of this machine, as :func:`render_in_processes` does.
        overwrite: Render again what is there.
        steady: Whether relative maps are made steady along the motion of the shot, which are all jobs.
        talk: How much is said.

    Raises:
        BokehnetError: Some frames failed, and which; or the renderer cannot be made.
    """
    talk, begun = talk or Talk(), perf_counter()
    wanted = [frame for frame, job in jobs.items() if overwrite or not job.output.exists()]
    done: dict[int, FrameSummary] = {}
    failed: dict[int, str] = {}
    settings = next(iter(jobs.values())).settings  # in what makes a renderer, frames are alike
    renderer = make_renderer(settings)  # here first, so that wrong weights are told once
    with ExitStack() as kept:
        decided, shot = dict(jobs), Shot()
        if wanted:
            with stages(hidden=talk.quiet) as begin:
                within = decided_jobs(jobs, renderer, steady=steady, begin=begin)
                decided, shot = kept.enter_context(within)
        left = {frame: decided[frame] for frame in wanted}
        outcomes: Outcomes
        if elsewhere is not None:
            del renderer
            outcomes = elsewhere(left, settings)
        elif processes > 1 and len(left) > 1:
            del renderer
            outcomes = render_in_processes(left, settings, min(processes, len(left)), quiet=talk.quiet)
        else:
            outcomes = _render_here(left, renderer)
        with progress("rendering frames", hidden=talk.quiet) as report, closing(outcomes):
            report(0, len(left))
            for count, (frame, outcome) in enumerate(outcomes, start=1):
                if isinstance(outcome, str):
                    failed[frame] = outcome
                    write_above(f"bokehnet: frame {frame}: {outcome}")
                else:
                    done[frame] = outcome
                    talk.of_frame(frame, outcome, first=len(done) == 1)
                report(count, len(left))
    seconds, there = perf_counter() - begun, len(jobs) - len(wanted)
    talk.of_frames(done, there=there, failed=failed, seconds=seconds, shot=shot)
    if failed:
        raise BokehnetError(
            f"{len(failed)} of {len(wanted)} frames failed: {format_frames(sorted(failed))}; "
            "the same command tries them again"
        )


def _render_here(
    jobs: Mapping[int, FrameJob], renderer: BokehRenderer
) -> Generator[tuple[int, FrameSummary | str], None, None]:
    for frame, job in jobs.items():
        yield frame, try_frame(job, renderer)


def try_frame(job: FrameJob, renderer: BokehRenderer) -> FrameSummary | str:
    """Render one frame; return what was done, or why it failed: one line, the traceback of a bug."""
    try:
        return render_frame(job, renderer)
    except BokehnetError as error:
        return " ".join(told(error).split())
    except MemoryError as error:
        return f"out of memory, try fewer --jobs ({error})"
    except Exception:
        return traceback.format_exc()


def render_in_processes(
    jobs: Mapping[int, FrameJob], settings: RenderSettings, processes: int, *, quiet: bool = False
) -> Generator[tuple[int, FrameSummary | str], None, None]:
    """Render ``jobs`` by frame, and yield each frame when it is done, with what was done or why it failed.

    Each process takes its share of the cores. One that dies fails its frame alone, another one takes its
    place. When the caller stops, by Ctrl-C too, all end at once and leave no half of a file.

    Args:
        jobs: By frame; started in their order.
        settings: What makes a renderer for all of them.
        processes: How many at a time.
        quiet: Whether they say nothing while they compile.
    """
    waiting = deque(jobs.items())
    threads = max(1, available_cores() // processes)
    idle: list[_Worker] = []
    busy: dict[Connection, tuple[_Worker, int]] = {}
    try:
        while waiting or busy:
            while waiting and len(busy) < processes:
                worker = (
                    idle.pop() if idle else _Worker(settings, threads, tell_compiling=not (busy or quiet))
                )
                frame, job = waiting.popleft()
                busy[worker.pipe] = worker, frame
                with contextlib.suppress(BrokenPipeError):  # it died; the pipe tells so below
                    worker.pipe.send(job)
            for pipe in wait(list(busy)):
                assert isinstance(pipe, Connection)
                worker, frame = busy.pop(pipe)
                try:
                    outcome: FrameSummary | str = pipe.recv()
                    idle.append(worker)
                except (EOFError, ConnectionResetError):
                    outcome = worker.last_words()
                yield frame, outcome
    finally:
        for worker in [*idle, *(worker for worker, _ in busy.values())]:
            worker.end()


class _Worker:
    """A process that renders what is sent to ``pipe``, and answers with what was done or why it failed."""

    def __init__(self, settings: RenderSettings, threads: int, tell_compiling: bool) -> None:
        context = multiprocessing.get_context("spawn")
        self.pipe, theirs = context.Pipe()
        self._process: SpawnProcess = context.Process(
            target=_serve, args=(theirs, settings, threads, tell_compiling), daemon=True
        )
        with _interrupts_held():
            self._process.start()
        theirs.close()  # so that the pipe ends with the process

    def end(self) -> None:
        """Stop, within a frame too; what it was writing is removed."""
        self._process.terminate()
        self.pipe.close()
        self._process.join()

    def last_words(self) -> str:
        """Say how the process died."""
        self._process.join()
        self.pipe.close()
        code = self._process.exitcode
        killed = code is not None and code < 0
        reason = f"killed by signal {-code}, out of memory?" if code and killed else f"exit code {code}"
        return f"the process that rendered it died ({reason})"


def _serve(pipe: Connection, settings: RenderSettings, threads: int, tell_compiling: bool) -> None:
    """Render until the pipe closes; the main function of a worker."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C reaches all; the parent decides
    signal.signal(signal.SIGTERM, lambda number, frame: sys.exit(1))  # writers clean up behind themselves
    _limit_threads(threads)
    renderer = make_renderer(settings, threads)
    with compile_notice() if tell_compiling else contextlib.nullcontext():
        while True:
            try:
                job = pipe.recv()
            except (EOFError, ConnectionResetError):  # the parent is done, or gone
                return
            outcome = try_frame(job, renderer)
            with contextlib.suppress(BrokenPipeError):
                pipe.send(outcome)


def _limit_threads(threads: int) -> None:
    numba.set_num_threads(min(threads, numba.get_num_threads()))
    oiio.attribute("threads", threads)


@contextlib.contextmanager
def _interrupts_held() -> Iterator[None]:
    """Let Ctrl-C wait: a process that starts inherits this, and does not die of it before it is ready."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    resource_tracker.ensure_running()  # else the first process starts it, which lets interrupts through again
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
