"""Summaries of renders: one line on stderr for people, one JSON object on stdout for programs."""

import json
import sys
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import click

from bokehnet.cli.options import with_option_names
from bokehnet.cli.progress import write_above
from bokehnet.render.result import RenderReport
from bokehnet.sequence.shot import Shot

__all__ = ["FrameSummary", "SummaryPrinter", "assumed"]


# Options against assumptions that a picture may not show to be wrong.
_OPTIONS_AGAINST = {"bright is near": " (--invert if not)"}


def assumed(assumptions: Sequence[str]) -> str:
    """Return the end of a summary line that names what neither settings nor files define."""
    words = "; ".join(with_option_names(text) + _OPTIONS_AGAINST.get(text, "") for text in assumptions)
    return f"; assumed: {words}" if words else ""


@dataclass(frozen=True, kw_only=True, slots=True)
class FrameSummary:
    """Summary of the render of one picture.

    Attributes:
        output: Output file.
        width: Width of the output, pixels.
        height: Height of the output, pixels.
        report: Report of the renderer.
        seconds: Time of each step: read, prepare (depth repair and focus), render, write.
    """

    output: str
    width: int
    height: int
    report: RenderReport
    seconds: Mapping[str, float]

    def line(self) -> str:
        """Return the summary as one line."""
        parts = [f"{self.width}x{self.height}", self.report.engine, self.report.focus_text]
        parts += [f"blur up to {self.report.largest_blur:.3g} px", self._repair()]
        parts.append(self.report.light)
        line = f"{self.output}: {', '.join(filter(None, [*parts, f'{sum(self.seconds.values()):.1f} s']))}"
        return line + assumed(self.report.assumptions)

    def steps(self) -> str:
        """Return the time of each step and the pixel filter as one line."""
        steps = ", ".join(f"{step} {seconds:.2f} s" for step, seconds in self.seconds.items())
        pixel_filter = self.report.pixel_filter
        return steps if pixel_filter is None else f"{steps}, pixel filter {pixel_filter}"

    def table(self) -> dict[str, Any]:
        """Return the summary as JSON-ready values; unknown values are None."""
        report = self.report
        return {
            "output": self.output,
            "width": self.width,
            "height": self.height,
            "engine": report.engine,
            "focus_disparity": report.focus_disparity,
            "focus_distance_m": report.focus_distance,
            "focus_far_disparity": report.focus_far_disparity,
            "focus_far_distance_m": report.focus_far_distance,
            "largest_blur_px": report.largest_blur,
            "repaired": report.repaired,
            "repair_reason": report.repair_reason,
            "pixel_filter": report.pixel_filter and str(report.pixel_filter.pixel_filter),
            "pixel_filter_reason": report.pixel_filter and report.pixel_filter.reason,
            "pixel_filter_confidence": report.pixel_filter and report.pixel_filter.confidence,
            "assumptions": [with_option_names(text) for text in report.assumptions],
            "recovered_light": report.light,
            "notes": [with_option_names(note) for note in report.notes],
            "seconds": {step: round(seconds, 3) for step, seconds in self.seconds.items()},
        }

    def _repair(self) -> str:
        if self.report.repaired is None:
            return "map unchanged"
        return f"map {'repaired' if self.report.repaired else 'not repaired'} ({self.report.repair_reason})"


@dataclass(frozen=True, kw_only=True, slots=True)
class SummaryPrinter:
    """Printer of summaries.

    Attributes:
        quiet: True to print only errors.
        verbose: True to print the time of each step as well.
        as_json: True to print one JSON object to stdout instead of the line.
    """

    quiet: bool = False
    verbose: bool = False
    as_json: bool = False

    def print_single(self, summary: FrameSummary) -> None:
        """Print the summary of a single picture."""
        if self.as_json:
            _print_json(summary.table())
        elif not self.quiet:
            for note in summary.report.notes:
                _print_line(f"note: {with_option_names(note)}")
            _print_line(summary.line())
        if self.verbose:
            _print_line(f"{summary.steps()}{_peak_memory()}")

    def print_sequence(
        self,
        done: Mapping[int, FrameSummary],
        *,
        existing: int,
        failed: Mapping[int, str],
        seconds: float,
        shot: Shot,
    ) -> None:
        """Print the summary of a sequence.

        Args:
            done: Summaries of the rendered frames.
            existing: Number of frames that existed before.
            failed: Error messages of the failed frames.
            seconds: Total time.
            shot: Decisions common to all frames.
        """
        if self.as_json:
            frames = {str(frame): done[frame].table() for frame in sorted(done)}
            errors = {str(frame): failed[frame] for frame in sorted(failed)}
            table = {"frames": frames, "there": existing, "failed": errors, "seconds": round(seconds, 3)}
            plan = None if shot.plan is None else asdict(shot.plan)
            _print_json(table | {"steady": shot.steady is not None, "plan": plan})
        elif not self.quiet:
            skipped = f", {existing} exist already (--overwrite renders them again)" if existing else ""
            around = f" with {_count(shot.around)} around them" if shot.around else ""
            smoothed = f", maps smoothed in time{around}" if shot.steady is not None else ""
            line = f"{_count(len(done))} rendered{skipped}{smoothed}, {seconds:.1f} s"
            _print_line(line + assumed(done[min(done)].report.assumptions if done else ()))

    def print_batch(
        self, done: Mapping[str, FrameSummary], *, existing: int, failed: Mapping[str, str], seconds: float
    ) -> None:
        """Print the summary of many pictures, and a line for each reason of failures, also if ``quiet``.

        Args:
            done: Summaries of the rendered pictures by file.
            existing: Number of pictures whose results existed before.
            failed: Error messages of the failed pictures by file.
            seconds: Total time.
        """
        if self.as_json:
            pictures = {name: summary.table() for name, summary in done.items()}
            table = {"pictures": pictures, "there": existing, "failed": dict(failed)}
            _print_json(table | {"seconds": round(seconds, 3)})
        elif not self.quiet:
            skipped = f", {existing} exist already (--overwrite renders them again)" if existing else ""
            _print_line(f"{_count(len(done), 'picture')} rendered{skipped}, {seconds:.1f} s")
        by_reason: dict[str, list[str]] = {}
        for name, message in failed.items():
            by_reason.setdefault(message.replace(name, ""), []).append(name)
        for names in by_reason.values():
            _print_line(f"failed: {', '.join(names)}: {with_option_names(failed[names[0]])}")

    def print_frame(self, frame: int, summary: FrameSummary, *, first: bool = False) -> None:
        """Print the summary of a frame if ``verbose``, and the notes of the first frame."""
        if first and not self.quiet and not self.as_json:
            for note in summary.report.notes:
                write_above(f"bokehnet: note: {with_option_names(note)}")
        if self.verbose:
            write_above(f"bokehnet: frame {frame}: {summary.line()} ({summary.steps()})")


def _print_line(text: str) -> None:
    click.echo(f"bokehnet: {text}", err=True)


def _print_json(table: dict[str, Any]) -> None:
    click.echo(json.dumps(table, allow_nan=False))


def _count(number: int, noun: str = "frame") -> str:
    return f"{number} {noun}{'' if number == 1 else 's'}"


def _peak_memory() -> str:
    """Return the peak memory of this process as text, or nothing if the system does not report it."""
    try:
        import resource
    except ImportError:  # Windows
        return ""
    unit = 1 if sys.platform == "darwin" else 1024
    return f", {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit / 1e9:.2f} GB peak memory"
