"""Build the Blender extension with all wheels it needs: ``integrations/build_blender.py -o FOLDER``.

Blender installs the wheels of the manifest for its own Python and platform; each build is for one of each. It
needs pip with a network, or a folder of wheels (``--find-links``). NumPy is included, since Blender's own may
be older than the other wheels require; the bokehnet process finds the included one first.
"""

import argparse
import os
import re
import subprocess
import sys
import sysconfig
import tempfile
import zipfile
from pathlib import Path

HERE = Path(__file__).resolve().parent
MANIFEST = "blender_manifest.toml"

# Blender's name of a platform, and the compatible wheel tags.
PLATFORMS = {
    "linux-x64": (
        "manylinux_2_28_x86_64",
        "manylinux_2_27_x86_64",
        "manylinux_2_17_x86_64",
        "manylinux2014_x86_64",
    ),
    "windows-x64": ("win_amd64",),
    "macos-arm64": ("macosx_14_0_arm64", "macosx_12_0_arm64", "macosx_11_0_arm64"),
}


def collect_wheels(folder: Path, platform: str, python: str, pip: list[str]) -> list[Path]:
    """Build bokehnet's wheel and download those of its dependencies.

    It carries machine code if this Python and this system are those of the Blender.
    """
    root = HERE.parent
    here = (sysconfig.get_python_version(), sysconfig.get_platform())
    if here != (python, "linux-x86_64") or platform != "linux-x64":
        os.environ["BOKEHNET_BUILD_KERNELS"] = "0"
    run([sys.executable, "-m", "pip", "wheel", "-q", "--no-deps", "-w", str(folder), str(root), *pip])
    (own,) = folder.glob("bokehnet-*.whl")
    tags = [word for tag in PLATFORMS[platform] for word in ("--platform", tag)]
    fetch = ["download", "-q", "--only-binary", ":all:", "--python-version", python, *tags, "-d", str(folder)]
    run([sys.executable, "-m", "pip", *fetch, str(own), *pip])
    return sorted(folder.glob("*.whl"))


def manifest_text(wheels: list[str], platform: str) -> str:
    """Return the manifest of a build: that of the source, for one platform, with its wheels."""
    text = (HERE / "blender" / MANIFEST).read_text(encoding="utf-8")
    entries = "".join(f'  "./wheels/{name}",\n' for name in wheels)
    added = f'platforms = ["{platform}"]\n'
    if wheels:
        added += f"wheels = [\n{entries}]\n"
    return re.sub(r"(?m)^(?=\[permissions\])", added + "\n", text, count=1)


def build(output: Path, wheels: list[Path], platform: str) -> Path:
    """Write the archive for installation in Blender.

    Args:
        output: Folder of the archive.
        wheels: Wheels to include; without any the extension needs a Python with bokehnet in its preferences.
        platform: A key of ``PLATFORMS``.
    """
    version = re.search(r'(?m)^version = "(.+)"$', (HERE / "blender" / MANIFEST).read_text(encoding="utf-8"))
    assert version is not None
    output.mkdir(parents=True, exist_ok=True)
    archive = output / f"bokehnet-{version[1]}-{platform}.zip"
    with zipfile.ZipFile(archive, "w", zipfile.ZIP_DEFLATED) as file:
        file.writestr(MANIFEST, manifest_text([wheel.name for wheel in wheels], platform))
        file.write(HERE.parent / "LICENSE", "LICENSE")
        for source in sorted((HERE / "blender").glob("*.py")):
            file.write(source, source.name)
        for wheel in wheels:
            file.write(wheel, f"wheels/{wheel.name}")
    return archive


def run(command: list[str]) -> None:
    """Run a command, and exit with an error if it fails."""
    done = subprocess.run(command, check=False)
    if done.returncode:
        raise SystemExit(
            f"build_blender: error: {' '.join(command[:6])} ... failed with code {done.returncode}"
        )


def main() -> None:
    """Build one archive."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("-o", "--output", type=Path, default=Path("dist"))
    parser.add_argument("--platform", choices=PLATFORMS, default="linux-x64")
    parser.add_argument("--python", default="3.11", help="Python version of Blender: 3.11 for 4.2 to 5.0")
    parser.add_argument("--no-wheels", action="store_true", help="include no wheels")
    parser.add_argument("--find-links", help="folder of wheels")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        pip = ["--find-links", arguments.find_links] if arguments.find_links else []
        wheels = []
        if not arguments.no_wheels:
            wheels = collect_wheels(Path(folder), arguments.platform, arguments.python, pip)
        archive = build(arguments.output, wheels, arguments.platform)
    print(f"{archive}: {archive.stat().st_size / 2**20:.1f} MiB, {len(wheels)} wheels")


if __name__ == "__main__":
    main()
