"""Shared parts of the tests of photo editors: a picture with its disparity, a task, the answer."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np

from bokehnet.io.image import read_image, write_image
from tests.conftest import ROOT

OPTIONS = "--blur 6 --focus 1 --repair-disparity off"


class Task:
    """Files of one rendering by an editor: photo.png, disparity.png, task.json, and the editor's report."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        rng = np.random.default_rng(1)
        disparity = np.zeros((60, 80, 3), np.float32)
        disparity[:, 30:50] = 1
        picture = np.kron(rng.random((10, 10, 3), dtype=np.float32), np.ones((6, 8, 1), np.float32))
        write_image(folder / "photo.png", picture)
        write_image(folder / "disparity.png", disparity)

    def run(
        self, words: list[str], environment: dict[str, str], options: str, depth: str, command: str | None
    ) -> dict:
        """Run an editor by ``words`` on the task: program, its options, name of the depth layer."""
        program = self.folder / "bokehnet"
        text = f'#!/bin/sh\nPYTHONPATH="{ROOT}" exec "{sys.executable}" -m bokehnet "$@"\n'
        program.write_text(text, encoding="utf-8")
        program.chmod(0o755)
        task = json.dumps([command or str(program), options, depth])
        (self.folder / "task.json").write_text(task, encoding="utf-8")
        done = subprocess.run(words, env=environment, capture_output=True, text=True, timeout=300)
        result = self.folder / "summary.json"
        assert result.exists(), done.stdout + done.stderr
        return json.loads(result.read_text(encoding="utf-8"))

    def check(self, result: Path, cli) -> None:
        """The editor's picture must be what the command line makes, and not the photograph."""
        lens = [*OPTIONS.split(), "--dither", "off"]
        words = ["--disparity", self.folder / "disparity.png", *lens, "-o", self.folder / "command.png"]
        assert cli("render", self.folder / "photo.png", *words).code == 0
        picture, expected = read_image(result), read_image(self.folder / "command.png")
        assert (
            np.abs(picture - expected).max() < 0.028
        )  # three levels of 8 bits near white: dither, two files
        assert np.abs(picture - read_image(self.folder / "photo.png")).max() > 0.1
