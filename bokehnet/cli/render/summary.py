"""What a rendering did: one line on stderr for people, one JSON object on stdout for programs."""

import json
import sys
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import typer

from bokehnet.cli.options import in_options
from bokehnet.cli.progress import write_above
from bokehnet.errors import ParameterError
from bokehnet.render.result import RenderReport
from bokehnet.sequence.shot import Shot

__all__ = ["FrameSummary", "Talk", "make_talk"]


@dataclass(frozen=True, kw_only=True, slots=True)
class FrameSummary:
    """What was done for one picture.

    Attributes:
        output: The file that was written.
        width: Of it, pixels.
        height: The same.
        report: What was decided.
        seconds: What each step took: read, prepare (mend the map, find the focus), render, write.
    """

    output: str
    width: int
    height: int
    report: RenderReport
    seconds: Mapping[str, float]

    def line(self) -> str:
        """Tell it in one line."""
        parts = [f"{self.width}x{self.height}", self.report.engine, self._focus()]
        parts += [f"blur up to {self.report.largest_blur:.3g} px", self._repair()]
        return f"{self.output}: {', '.join(filter(None, [*parts, f'{sum(self.seconds.values()):.1f} s']))}"

    def steps(self) -> str:
        """Tell in one line what each step took, and by which filter pixels were parted."""
        steps = ", ".join(f"{step} {seconds:.2f} s" for step, seconds in self.seconds.items())
        chosen = self.report.pixel_filter
        return steps if chosen is None else f"{steps}, pixel filter {chosen}"

    def table(self) -> dict[str, Any]:
        """Tell it to a program; what was not found is null."""
        report = self.report
        return {
            "output": self.output,
            "width": self.width,
            "height": self.height,
            "engine": report.engine,
            "focus_disparity": report.focus_disparity,
            "focus_distance_m": report.focus_distance,
            "largest_blur_px": report.largest_blur,
            "repaired": report.repaired,
            "repair_reason": report.repair_reason,
            "pixel_filter": report.pixel_filter and str(report.pixel_filter.pixel_filter),
            "pixel_filter_reason": report.pixel_filter and report.pixel_filter.reason,
            "pixel_filter_confidence": report.pixel_filter and report.pixel_filter.confidence,
            "notes": [in_options(note) for note in report.notes],
            "seconds": {step: round(seconds, 3) for step, seconds in self.seconds.items()},
        }

    def _focus(self) -> str:
        report = self.report
        if report.focus_distance is not None:
            return f"focus at {report.focus_distance:.3g} m"
        return "" if report.focus_disparity is None else f"focus at {report.focus_disparity:.3g}"

    def _repair(self) -> str:
        if self.report.repaired is None:
            return "map as it is"
        return f"map {'repaired' if self.report.repaired else 'not repaired'} ({self.report.repair_reason})"


@dataclass(frozen=True, kw_only=True, slots=True)
class Talk:
    """How much a command says.

    Attributes:
        quiet: Nothing but errors.
        verbose: What each step took, too.
        as_json: One JSON object on stdout in place of the line.
    """

    quiet: bool = False
    verbose: bool = False
    as_json: bool = False

    def of_one(self, summary: FrameSummary) -> None:
        """Tell what was done for a picture."""
        if self.as_json:
            _print_json(summary.table())
        elif not self.quiet:
            for note in summary.report.notes:
                _say(f"note: {in_options(note)}")
            _say(summary.line())
        if self.verbose:
            _say(f"{summary.steps()}{_peak_memory()}")

    def of_frames(
        self,
        done: Mapping[int, FrameSummary],
        *,
        there: int,
        failed: Mapping[int, str],
        seconds: float,
        shot: Shot,
    ) -> None:
        """Tell what was done for a sequence.

        Args:
            done: What was rendered, by frame.
            there: How many frames were there already.
            failed: Why others were not rendered.
            seconds: What all took.
            shot: What was decided once for all of them.
        """
        if self.as_json:
            frames = {str(frame): done[frame].table() for frame in sorted(done)}
            errors = {str(frame): failed[frame] for frame in sorted(failed)}
            table = {"frames": frames, "there": there, "failed": errors, "seconds": round(seconds, 3)}
            plan = None if shot.plan is None else asdict(shot.plan)
            _print_json(table | {"steady": shot.steady is not None, "plan": plan})
        elif not self.quiet:
            older = f", {there} there already (--overwrite renders them again)" if there else ""
            steady = ", maps made steady" if shot.steady is not None else ""
            _say(f"{_count(len(done))} rendered{older}{steady}, {seconds:.1f} s")

    def of_frame(self, frame: int, summary: FrameSummary, *, first: bool = False) -> None:
        """Tell what was done for a frame of a sequence if that is asked for; of the first what looks odd."""
        if first and not self.quiet and not self.as_json:
            for note in summary.report.notes:
                write_above(f"bokehnet: note: {in_options(note)}")
        if self.verbose:
            write_above(f"bokehnet: frame {frame}: {summary.line()} ({summary.steps()})")


def make_talk(*, quiet: bool, verbose: bool, as_json: bool) -> Talk:
    """Check what was asked for; ``ParameterError`` where it contradicts itself."""
    if quiet and verbose:
        raise ParameterError("--quiet", "to stand without --verbose", shown="both", remedy="leave one out")
    return Talk(quiet=quiet, verbose=verbose, as_json=as_json)


def _say(text: str) -> None:
    typer.echo(f"bokehnet: {text}", err=True)


def _print_json(table: dict[str, Any]) -> None:
    typer.echo(json.dumps(table, allow_nan=False))


def _count(frames: int) -> str:
    return f"{frames} frame{'' if frames == 1 else 's'}"


def _peak_memory() -> str:
    """The most memory that this process has held, where the system tells it."""
    try:
        import resource
    except ImportError:  # Windows
        return ""
    unit = 1 if sys.platform == "darwin" else 1024
    return f", {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit / 1e9:.2f} GB at most"
