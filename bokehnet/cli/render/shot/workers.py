"""Rendering of many frames in one or several processes; a failed frame does not stop the others."""

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

from bokehnet.cli.options import message_of
from bokehnet.cli.progress import compile_notice, progress, stages, write_above
from bokehnet.cli.render.frame import FrameJob, make_renderer, render_frame
from bokehnet.cli.render.shot.shot_files import decided_jobs
from bokehnet.cli.render.summary import FrameSummary, SummaryPrinter
from bokehnet.errors import BokehnetError
from bokehnet.render.renderer import BokehRenderer
from bokehnet.sequence.frame_names import format_frames
from bokehnet.sequence.shot import Shot
from bokehnet.settings.settings import RenderSettings

__all__ = ["available_cores", "render_frames", "render_here", "render_in_processes", "try_frame"]

# Frames on completion, each with its summary or its error message.
Outcomes = Generator[tuple[int, FrameSummary | str], None, None]


def available_cores() -> int:
    """Return the number of cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def render_frames(
    jobs: Mapping[int, FrameJob],
    *,
    context: Mapping[int, FrameJob] | None = None,
    processes: int = 1,
    cluster: Callable[[Mapping[int, FrameJob], RenderSettings], Outcomes] | None = None,
    overwrite: bool = False,
    steady: bool = True,
    printer: SummaryPrinter | None = None,
) -> None:
    """Render all frames whose outputs do not exist, or are empty, truncated or of another size.

    A frame that fails prints an error to stderr and does not stop the others.

    Args:
        jobs: Frame number to job, all frames to render.
        context: Further frames of the shot to read; see :func:`decided_jobs`.
        processes: Number of parallel processes; each gets an equal number of the cores.
        cluster: Function that renders jobs elsewhere, with the interface of :func:`render_in_processes`.
        overwrite: True to render existing outputs again.
        steady: True to smooth relative maps along the motion of the shot.
        printer: Printer of summaries.

    Raises:
        BokehnetError: Some frames failed, or the renderer cannot be made.
    """
    printer, begun = printer or SummaryPrinter(), perf_counter()
    pending = [frame for frame, job in jobs.items() if overwrite or not job.is_finished]
    done: dict[int, FrameSummary] = {}
    failed: dict[int, str] = {}
    settings = next(iter(jobs.values())).settings  # equal for all frames where a renderer depends on them
    renderer = make_renderer(settings)  # made before the workers: invalid weights raise once
    with ExitStack() as stack:
        decided, shot = dict(jobs), Shot()
        if pending:
            with stages(hidden=printer.quiet) as begin:
                decisions = decided_jobs(jobs, renderer, context=context, steady=steady, begin=begin)
                decided, shot = stack.enter_context(decisions)
        remaining = {frame: decided[frame] for frame in pending}
        outcomes: Outcomes
        if cluster is not None:
            del renderer
            outcomes = cluster(remaining, settings)
        elif processes > 1 and len(remaining) > 1:
            del renderer
            outcomes = render_in_processes(
                remaining, settings, min(processes, len(remaining)), quiet=printer.quiet
            )
        else:
            outcomes = render_here(remaining, renderer)
        with progress("rendering frames", hidden=printer.quiet) as report, closing(outcomes):
            report(0, len(remaining))
            for count, (frame, outcome) in enumerate(outcomes, start=1):
                if isinstance(outcome, str):
                    failed[frame] = outcome
                    write_above(f"bokehnet: frame {frame}: {outcome}")
                else:
                    done[frame] = outcome
                    printer.print_frame(frame, outcome, first=len(done) == 1)
                report(count, len(remaining))
    seconds, existing = perf_counter() - begun, len(jobs) - len(pending)
    printer.print_sequence(done, existing=existing, failed=failed, seconds=seconds, shot=shot)
    if failed:
        raise BokehnetError(
            f"{len(failed)} of {len(pending)} frames failed: {format_frames(sorted(failed))}; "
            "run the same command to try them again"
        )


def render_here(
    jobs: Mapping[int, FrameJob], renderer: BokehRenderer
) -> Generator[tuple[int, FrameSummary | str], None, None]:
    """Render ``jobs`` in this process and yield each with its summary or its error message."""
    for frame, job in jobs.items():
        yield frame, try_frame(job, renderer)


def try_frame(job: FrameJob, renderer: BokehRenderer) -> FrameSummary | str:
    """Render one frame; return its summary, a one-line error message, or the traceback of a bug."""
    try:
        return render_frame(job, renderer)
    except BokehnetError as error:
        return " ".join(message_of(error).split())
    except MemoryError as error:
        return f"out of memory, try fewer --jobs ({error})"
    except Exception:
        return traceback.format_exc()


def render_in_processes(
    jobs: Mapping[int, FrameJob], settings: RenderSettings, processes: int, *, quiet: bool = False
) -> Generator[tuple[int, FrameSummary | str], None, None]:
    """Render ``jobs`` and yield each frame on completion, with its summary or its error message.

    The processes share the cores equally. If one dies, only its frame fails and a new process replaces it.
    When the caller stops, also by Ctrl-C, all processes end at once and leave no partial files.

    Args:
        jobs: Frame number to job; started in this order.
        settings: Settings for the renderer of all jobs.
        processes: Number of parallel processes.
        quiet: True to omit the notice while kernels compile.
    """
    waiting = deque(jobs.items())
    threads = max(1, available_cores() // processes)
    idle: list[_Worker] = []
    busy: dict[Connection, tuple[_Worker, int]] = {}
    try:
        while waiting or busy:
            while waiting and len(busy) < processes:
                worker = (
                    idle.pop() if idle else _Worker(settings, threads, show_compiling=not (busy or quiet))
                )
                frame, job = waiting.popleft()
                busy[worker.pipe] = worker, frame
                with contextlib.suppress(BrokenPipeError):  # the worker died; handled below
                    worker.pipe.send(job)
            for pipe in wait(list(busy)):
                assert isinstance(pipe, Connection)
                worker, frame = busy.pop(pipe)
                try:
                    outcome: FrameSummary | str = pipe.recv()
                    idle.append(worker)
                except (EOFError, ConnectionResetError):
                    outcome = worker.death_message()
                yield frame, outcome
    finally:
        for worker in [*idle, *(worker for worker, _ in busy.values())]:
            worker.end()


class _Worker:
    """Process that renders jobs sent to ``pipe`` and answers with a summary or an error message."""

    def __init__(self, settings: RenderSettings, threads: int, show_compiling: bool) -> None:
        context = multiprocessing.get_context("spawn")
        self.pipe, worker_end = context.Pipe()
        self._process: SpawnProcess = context.Process(
            target=_serve, args=(worker_end, settings, threads, show_compiling), daemon=True
        )
        with _interrupts_held():
            self._process.start()
        worker_end.close()  # so that the pipe closes with the process

    def end(self) -> None:
        """Stop the process, even within a frame; partial files are removed."""
        self._process.terminate()
        self.pipe.close()
        self._process.join()

    def death_message(self) -> str:
        """Return a message about the cause of the process's death."""
        self._process.join()
        self.pipe.close()
        code = self._process.exitcode
        killed = code is not None and code < 0
        reason = f"killed by signal {-code}, out of memory?" if code and killed else f"exit code {code}"
        return f"the process that rendered it died ({reason})"


def _serve(pipe: Connection, settings: RenderSettings, threads: int, show_compiling: bool) -> None:
    """Render until the pipe closes; main function of a worker."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C reaches all processes; the parent handles it
    signal.signal(signal.SIGTERM, lambda number, frame: sys.exit(1))  # writers remove partial files
    _limit_threads(threads)
    renderer = make_renderer(settings, threads)
    with compile_notice() if show_compiling else contextlib.nullcontext():
        while True:
            try:
                job = pipe.recv()
            except (EOFError, ConnectionResetError):  # the parent has finished or died
                return
            outcome = try_frame(job, renderer)
            with contextlib.suppress(BrokenPipeError):
                pipe.send(outcome)


def _limit_threads(threads: int) -> None:
    numba.set_num_threads(min(threads, numba.get_num_threads()))
    oiio.attribute("threads", threads)


@contextlib.contextmanager
def _interrupts_held() -> Iterator[None]:
    """Block SIGINT: a starting process inherits this and survives Ctrl-C until it is ready."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    resource_tracker.ensure_running()  # starting it later would unblock SIGINT
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
