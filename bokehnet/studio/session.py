"""State of the studio: opened picture, settings, strokes and background jobs."""

import shutil
import tempfile
import threading
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from time import monotonic
from typing import Any

from bokehnet.errors import BokehnetError, ParameterError, RenderCancelled
from bokehnet.inference.depth_models import recommended_model
from bokehnet.inference.model_download import fetch_model
from bokehnet.settings.fields import field_settings
from bokehnet.settings.preset import presets
from bokehnet.settings.settings import RenderSettings, all_settings, merged
from bokehnet.settings.settings_file import save_settings
from bokehnet.studio.background import BackgroundProcess
from bokehnet.studio.export import render_file, with_painted_map
from bokehnet.studio.failures import failure_message
from bokehnet.studio.files.archive import read_session, write_session
from bokehnet.studio.files.saved_session import session_content, session_state
from bokehnet.studio.files.uploads import safe_name
from bokehnet.studio.history import History, State
from bokehnet.studio.looks import settings_of_new_picture, settings_with_depth, settings_with_preset
from bokehnet.studio.opened import FLAT_DISPARITY, Opened, extra_light, open_picture, repaired_map
from bokehnet.studio.panels.help_texts import words_of_change
from bokehnet.studio.panels.panels import check_reachable, is_path
from bokehnet.studio.panels.wording import command_line, look_of, python_lines
from bokehnet.studio.preview.preview import Previews
from bokehnet.studio.strokes import Stroke

__all__ = ["Session"]

_MAX_OPENING_SECONDS, _MAX_ESTIMATE_SECONDS = 90.0, 900.0
_OUTPUTS = (".png", ".jpg", ".jpeg", ".tif", ".tiff", ".exr", ".webp", ".jxl")


class Session:
    """Session of the studio, whose pages share the picture and its settings; deletes its files at the end.

    Attributes:
        folder: Temporary folder for uploads and results.
        opened: Opened picture, or None.
        settings: Settings of the render.
        previews: Renderer of previews.
        preset: Name of the selected preset; empty without one.
        slow: Background process for repair, the estimate of light, and opening during an export.
        fine: Background process for final previews and thumbnails.
        exporter: Background process for opening and export, at normal priority, as users wait for both.
        jobs: State and progress of repair, light, depth estimate and export.
    """

    def __init__(self) -> None:
        self._holder = tempfile.TemporaryDirectory(prefix="bokehnet_studio_", ignore_cleanup_errors=True)
        self.folder = Path(self._holder.name)
        self.opened: Opened | None = None
        self.settings = RenderSettings()
        self.preset = ""
        self.initial: dict[str, dict[str, Any]] = {}
        self.slow, self.fine = BackgroundProcess(), BackgroundProcess(modules=[Previews.__module__])
        self.exporter = BackgroundProcess(0, modules=[open_picture.__module__, render_file.__module__])
        self.previews = Previews(self.fine)
        self._lock = threading.Lock()
        self._export_stop = threading.Event()
        self._opening = threading.Event()
        self.jobs: dict[str, dict[str, Any]] = {
            name: {"state": "idle"} for name in ("repair", "light", "estimate", "export")
        }
        self._history = History()
        self._serial = 0
        self._result: Path | None = None
        self._uploads: list[Path] = []

    def start(self) -> None:
        """Start the background processes in advance."""
        self.exporter.start()
        self.fine.start()
        self.previews.prepare_shapes(self.with_preset(name).aperture for name in presets())

    def close(self) -> None:
        """Stop all jobs and delete the files."""
        self._opening.set()
        self._export_stop.set()
        self.previews.close()
        self.slow.stop()
        self.fine.stop()
        self.exporter.stop()
        self._holder.cleanup()

    def open(
        self,
        path: Path,
        settings: RenderSettings,
        strokes: list[Stroke] | None = None,
        *,
        fallback: RenderSettings | None = None,
        seconds: float = _MAX_OPENING_SECONDS,
    ) -> None:
        """Open a picture in place of the current one, which stays open on failure.

        Args:
            path: Picture.
            settings: Settings with its depth.
            strokes: Strokes on the map.
            fallback: Settings to try if the picture cannot be opened with ``settings``.
            seconds: Time limit.

        Raises:
            BokehnetError: The picture cannot be read, or not in time.
        """
        self._opening.set()  # cancels the repair of the previous picture
        try:
            scene, requested, complete = self._read(path, settings, fallback, seconds)
        except BokehnetError as error:
            self._opening = threading.Event()
            if self.opened is not None and self.opened.repaired is None:
                self._repair()  # restart for the current picture
            self._uploads += [path.parent] if self.folder in path.parents else []
            self._remove_unused()
            raise self._without_paths(error) from error
        with self._lock:
            is_new = self.opened is None or self.opened.path != path
            self.opened, self.settings = Opened(path, scene, requested, complete), complete
            self.opened.strokes = strokes or []
            self._opening = threading.Event()
            self.jobs["repair"] = self.jobs["light"] = {"state": "idle"}
            if is_new and self.jobs["export"]["state"] != "running":
                self.jobs["export"] = {"state": "idle"}
            self._serial += 1
            self._history.clear()
            self.initial = self.shown_settings()
            values = (getattr(getattr(complete, one.group), one.name) for one in all_settings().values())
            folders = {path.parent, *(value.parent for value in values if isinstance(value, Path))}
            self._uploads += [folder for folder in folders if self.folder in folder.parents]
            self._remove_unused()
        self._repair()

    def _read(
        self, path: Path, settings: RenderSettings, fallback: RenderSettings | None, seconds: float
    ) -> Any:
        """Return the scene of a picture, and its settings as requested and complete."""
        process = self.slow if self.jobs["export"]["state"] == "running" else self.exporter
        return process.run(open_picture, path, settings, fallback, seconds=seconds)

    def with_look(self, inputs: Mapping[str, Any]) -> RenderSettings:
        """Return the settings of a new picture: its depth, and the look of the selected preset."""
        return settings_of_new_picture(inputs, self.preset)

    def with_depth(self, inputs: Mapping[str, Any]) -> RenderSettings:
        """Return the current settings with another depth, and without what belongs to the present one."""
        return settings_with_depth(self.settings, inputs)

    def change(self, changes: Mapping[str, Any]) -> RenderSettings:
        """Apply changes from a page, all or none; null resets a field to its default.

        Args:
            changes: Group name to field name to plain value.

        Raises:
            ParameterError: A name is unknown, a value is out of range or names a local file.
        """
        with self._lock:
            before, table = self.settings, self.settings.to_table()
            values: dict[str, dict[str, Any]] = {}
            for group, fields in changes.items():
                if not isinstance(fields, Mapping):
                    raise ParameterError(group, expected="fields and their values", shown="something else")
                for name, value in fields.items():
                    if f"{group}.{name}" not in all_settings():
                        raise ParameterError(f"{group}.{name}", expected="a setting", shown="an unknown name")
                    if value is None:
                        table.get(group, {}).pop(name, None)
                    else:
                        values.setdefault(group, {})[name] = value
            check_reachable(values, before)
            settings = RenderSettings().updated(merged(table, values))
            if settings != before:
                controls = [f"{group}.{name}" for group, fields in changes.items() for name in fields]
                self._remember(words_of_change(changes), controls or list(changes))
            self.settings = settings
        self._repair_again(before)
        return settings

    def _repair_again(self, before: RenderSettings) -> None:
        """Repair the map again after a change of the mode of repair."""
        opened, settings = self.opened, self.settings
        if opened is None or settings.depth.repair == before.depth.repair:
            return
        self._opening.set()
        self._opening = threading.Event()
        opened.take_repaired(opened.scene.depth.values, True, "")
        opened.repaired = None
        self._repair()

    def _remember(self, change: str, control: Any = None) -> None:
        """Add the current state to the history; see :meth:`History.remember`."""
        self._history.remember(self._present, change, control)

    @property
    def _present(self) -> State:
        strokes = () if self.opened is None else tuple(self.opened.strokes)
        return State(settings=self.settings, strokes=strokes, preset=self.preset)

    def apply_preset(self, preset: str) -> RenderSettings:
        """Apply a shipped preset in place of the current look."""
        with self._lock:
            settings = settings_with_preset(self.settings, preset)
            if (settings, preset) != (self.settings, self.preset):
                self._remember(f"Preset {preset or 'none'}")
            self.settings, self.preset = settings, preset
            return settings

    def with_preset(self, preset: str) -> RenderSettings:
        """Return the settings with the look of a shipped preset."""
        with self._lock:
            return settings_with_preset(self.settings, preset)

    @property
    def history(self) -> dict[str, Any]:
        """Number of steps that can be undone, of those that can be redone, and the words of all."""
        return self._history.summary

    def stroke(self, table: Mapping[str, Any]) -> None:
        """Add a stroke of the brush."""
        opened = self._open_one()
        with self._lock:
            stroke = Stroke.from_table(table)
            self._remember(f"Brush: {stroke.effect}")
            opened.change_strokes([*opened.strokes, stroke])

    def step(self, back: bool, count: int = 1) -> None:
        """Undo or redo changes of settings, preset or strokes.

        Args:
            back: True to undo.
            count: Number of changes; those that do not exist are ignored.
        """
        opened, before = self._open_one(), self.settings
        with self._lock:
            step = self._history.step(self._present, back, count)
            self.settings, self.preset = step.settings, step.preset
            if step.strokes != tuple(opened.strokes):
                opened.change_strokes(step.strokes)
        self._repair_again(before)

    def export(self, name: str) -> None:
        """Start the export of the shown command; ``jobs["export"]`` contains its progress.

        Raises:
            BokehnetError: No picture is open, another export runs, or the name is no picture file.
        """
        opened, name = self._open_one(), safe_name(name, _OUTPUTS)
        with self._lock:
            if self.jobs["export"]["state"] == "running":
                raise BokehnetError("expected one export at a time; wait for it, or stop it")
            self._export_stop = threading.Event()
            self.jobs["export"] = {"state": "running", "share": 0.0, "name": name, "seconds": 0.0}
            settings = self.settings
        threading.Thread(target=self._export, args=(opened, settings, name), daemon=True).start()

    def stop_export(self) -> None:
        """Stop the running export."""
        self._export_stop.set()

    def result(self) -> Path:
        """Return the file of the last export."""
        if self._result is None:
            raise BokehnetError("nothing exported yet")
        return self._result

    def equivalents(self, output: str) -> dict[str, str]:
        """Return the equivalent command line and Python script, and the name of the painted map."""
        opened, output = self._open_one(), safe_name(output, _OUTPUTS)
        settings, painted = with_painted_map(opened, self.settings, self._results_folder(), write=False)
        return {
            "command": command_line(opened.path, output, settings, self.shown),
            "python": python_lines(opened.path, output, settings, self.shown),
            "map": "" if painted is None else painted.name,
        }

    def painted_map(self) -> Path:
        """Return the file of the painted map."""
        _, path = with_painted_map(self._open_one(), self.settings, self._results_folder())
        if path is None:
            raise BokehnetError("nothing painted yet")
        return path

    def preset_text(self) -> str:
        """Return the current look as the text of a preset file."""
        path = self._results_folder() / "preset.toml"
        save_settings(path, look_of(self.settings))
        return f'description = "A look of the studio"\n\n{path.read_text("utf-8")}'

    def save(self) -> Path:
        """Write the session to a file and return its path."""
        opened = self._open_one()
        content, files = session_content(opened.path, self._present)
        path = self._results_folder() / f"{opened.path.stem}.bokeh"
        write_session(path, content, files)
        return path

    def reopen(self, path: Path) -> None:
        """Open a saved session.

        Raises:
            BokehnetError: It is no session file, or its content cannot be read.
        """
        folder = Path(tempfile.mkdtemp(dir=self.folder))
        table = read_session(path, folder)
        shutil.rmtree(path.parent, ignore_errors=True)
        picture, state = session_state(table, folder)
        self.open(picture, state.settings, list(state.strokes))
        self.preset = state.preset

    def incoming(self, name: str) -> Path:
        """Return a path for an upload, in a folder of its own to avoid name clashes."""
        return Path(tempfile.mkdtemp(dir=self.folder)) / name

    def shown(self, path: Path) -> str:
        """Return the name of a path for the page: the file name for uploads, else the full path."""
        return path.name if self.folder in path.parents else str(path)

    def state(self) -> dict[str, Any]:
        """Return the complete state for a page."""
        opened = self.opened
        if opened is None:
            return {"open": False, "jobs": self.jobs}
        return {
            "open": True,
            "name": opened.path.name,
            "width": opened.size[0],
            "height": opened.size[1],
            "kind": opened.scene.depth.kind,
            "flat": self.settings.input.constant_disparity == FLAT_DISPARITY,
            "photograph": opened.has_clipped_light,
            "notes": [self._clean(note) for note in (*opened.scene.notes, *opened.scene.depth.notes)],
            "repaired": opened.repaired,
            "repair_reason": opened.repair_reason,
            "strokes": len(opened.strokes),
            **self.history,
            "version": opened.version,
            "picture": self._serial,
            "preset": self.preset,
            "initial": self.initial,
            "export_name": f"{opened.path.stem}_bokeh{opened.export_suffix}",
            "settings": self.shown_settings(),
            "jobs": self.jobs,
        }

    def shown_settings(self) -> dict[str, dict[str, Any]]:
        """Return the settings that differ from their defaults, with file names in place of paths."""
        table = self.settings.to_table()
        for group, fields in table.items():
            known = field_settings(type(getattr(self.settings, group)))
            for key in fields:
                if isinstance(getattr(getattr(self.settings, group), key), Path) and is_path(known[key]):
                    fields[key] = Path(fields[key]).name
        return table

    def _open_one(self) -> Opened:
        if self.opened is None:
            raise BokehnetError("expected an open picture; drop one on the page")
        return self.opened

    def _repair(self) -> None:
        """Start the repair of the map and the estimate of clipped light, where they apply."""
        opened, mode, stop = self.opened, self.settings.depth.repair, self._opening
        if opened is None:
            return
        tasks: list[Callable[[], None]] = []
        if mode != "off" and opened.can_be_repaired:
            self.jobs["repair"] = {"state": "running", "share": 0.0}
            tasks.append(lambda: self._repair_now(opened, mode, stop))
        if opened.has_clipped_light and opened.light is None:
            self.jobs["light"] = {"state": "running"}
            tasks.append(lambda: self._estimate_light(opened, stop))
        if tasks:
            threading.Thread(target=lambda: [task() for task in tasks], daemon=True).start()

    def _estimate_light(self, opened: Opened, stop: threading.Event) -> None:
        try:
            light = self.slow.run(extra_light, opened.scene, opened.values, cancel=stop)
        except RenderCancelled:
            return
        except BokehnetError as error:
            self.jobs["light"] = {"state": "failed", "error": self._clean(str(error))}
            return
        if not stop.is_set():
            opened.take_light(light)
            self.jobs["light"] = {"state": "done", "note": light.note}

    def estimate(self, *, agreed: bool) -> None:
        """Start the estimate of depth by the network of :func:`bokehnet.studio.looks.depth_offer`.

        Args:
            agreed: True if the user has agreed to the download of the network.

        Raises:
            BokehnetError: No picture is open, another estimate runs, or no network can be downloaded.
        """
        opened, model = self._open_one(), recommended_model()
        if model is None:
            raise BokehnetError("expected a depth network; this version names none")
        with self._lock:
            if self.jobs["estimate"]["state"] == "running":
                raise BokehnetError("expected one estimate at a time; wait for it")
            self.jobs["estimate"] = {"state": "running", "share": 0.0}

        def progress(done: int, total: int) -> None:
            self.jobs["estimate"] = {"state": "running", "share": done / max(total, 1)}

        def run() -> None:
            try:
                fetch_model(model, lambda offer: agreed, progress)
                if self.opened is not opened:  # another picture was opened meanwhile
                    self.jobs["estimate"] = {"state": "idle"}
                    return
                settings = self.with_depth({"depth_model": model.name})
                self.open(opened.path, settings, seconds=_MAX_ESTIMATE_SECONDS)
                self.jobs["estimate"] = {"state": "done"}
            except Exception as error:
                self.jobs["estimate"] = {"state": "failed", "error": self._clean(failure_message(error))}

        threading.Thread(target=run, daemon=True).start()

    def _repair_now(self, opened: Opened, mode: str, stop: threading.Event) -> None:
        def progress(done: int, total: int) -> None:
            if not stop.is_set():
                self.jobs["repair"] = {"state": "running", "share": done / max(total, 1)}

        try:
            repair = self.slow.run(repaired_map, opened.scene, mode, progress=progress, cancel=stop)
        except RenderCancelled:
            return
        except BokehnetError as error:
            self.jobs["repair"] = {"state": "failed", "error": self._clean(str(error))}
            return
        if not stop.is_set():
            with self._lock:
                opened.take_repaired(*repair)
                if (settings := opened.refocused(self.settings)) != self.settings:
                    self.settings = settings
                    self.initial = self.shown_settings()
            self.jobs["repair"] = {"state": "done", "reason": opened.repair_reason}

    def _export(self, opened: Opened, settings: RenderSettings, name: str) -> None:
        begun = monotonic()

        def progress(done: int, total: int) -> None:
            seconds = monotonic() - begun
            share = done / max(total, 1)
            self.jobs["export"] = {"state": "running", "share": share, "name": name, "seconds": seconds}

        folder = Path(tempfile.mkdtemp(dir=self.folder))
        try:
            complete, _ = with_painted_map(opened, settings, folder)
            complete = replace(complete, output=replace(complete.output, save_maps=None))
            arguments = (opened.path, folder / name, complete)
            facts = self.exporter.run(render_file, *arguments, progress=progress, cancel=self._export_stop)
            if self._result is not None:
                shutil.rmtree(self._result.parent, ignore_errors=True)
            self._result = folder / name
            self.jobs["export"] = {
                "state": "done",
                "name": name,
                "bytes": self._result.stat().st_size,
                **facts,
            }
        except RenderCancelled:
            shutil.rmtree(folder, ignore_errors=True)
            self.jobs["export"] = {"state": "idle"}
        except Exception as error:
            self.jobs["export"] = {"state": "failed", "error": self._clean(failure_message(error))}

    def _remove_unused(self) -> None:
        """Delete uploads that are no longer used: previous pictures, and those that could not be opened."""
        used = set() if self.opened is None else {self.opened.path.parent}
        for known in all_settings().values():
            value = getattr(getattr(self.settings, known.group), known.name)
            used |= {value.parent} if isinstance(value, Path) else set()
        for folder in [folder for folder in self._uploads if folder not in used]:
            self._uploads.remove(folder)
            shutil.rmtree(folder, ignore_errors=True)

    def _results_folder(self) -> Path:
        folder = self.folder / "made"
        folder.mkdir(exist_ok=True)
        return folder

    def _without_paths(self, error: BokehnetError) -> BokehnetError:
        return error if self._clean(str(error)) == str(error) else BokehnetError(self._clean(str(error)))

    def _clean(self, text: str) -> str:
        """Return a message without the paths of the studio's temporary folders."""
        words = text.split(str(self.folder))
        return words[0] + "".join(word.split("/", 2)[-1] for word in words[1:])
