"""Build hook of wheels: compile the kernels (``tools/kernel_library.py``) and pack the machine code.

If this fails for any reason, the build makes a wheel for all platforms without machine code, and numba
compiles the kernels at their first call. ``BOKEHNET_BUILD_KERNELS=0`` builds such a wheel directly. Editable
installs contain no machine code, because their kernels may change.
"""

import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

from packaging import tags

SWITCH = "BOKEHNET_BUILD_KERNELS"
TARGET = "bokehnet/precompiled/machine_code"


class KernelHook(BuildHookInterface):
    """Compile kernels before a wheel is packed, and remove the compiled files afterwards."""

    _folder: Any = None

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Add machine code and the tag of its platform and Python version.

        The keys of machine code cover bytecode, which is specific to one minor version of Python.
        """
        if version == "editable" or os.environ.get(SWITCH, "1") == "0":
            return
        self._folder = tempfile.TemporaryDirectory(prefix="bokehnet-kernels-")
        folder = Path(self._folder.name)
        try:
            _compile(Path(self.root), folder)
        except Exception as error:  # the package works without machine code
            print(
                f"bokehnet: warning: no machine code is packed, kernels are compiled at first use: {error}",
                file=sys.stderr,
            )
            return
        for path in folder.iterdir():
            build_data["force_include"][str(path)] = f"{TARGET}/{path.name}"
        build_data["pure_python"] = False
        build_data["tag"] = f"{tags.interpreter_name()}{tags.interpreter_version()}-none-{_platform()}"

    def finalize(self, version: str, build_data: dict[str, Any], artifact_path: str) -> None:
        """Remove the compiled files."""
        if self._folder is not None:
            self._folder.cleanup()


def _compile(root: Path, folder: Path) -> None:
    """Run the compiler in a separate process that imports the package from this checkout."""
    paths = [
        str(root),
        *filter(None, [os.environ.get("PYTHONPATH")]),
    ]  # PYTHONPATH of pip, with the build requirements
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(paths)}
    command = [sys.executable, "-m", "tools.kernel_library", str(folder)]
    process = subprocess.run(command, cwd=root, env=environment, check=False, stdout=sys.stderr)
    if process.returncode:
        raise OSError(f"tools.kernel_library ended with code {process.returncode}")


def _platform() -> str:
    """Return the platform tag.

    Machine code links to no system library, so on Linux the oldest glibc that numba supports suffices.
    """
    platforms = list(tags.platform_tags())
    return next((name for name in platforms if name.startswith("manylinux_2_17_")), platforms[0])
