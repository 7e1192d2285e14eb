"""Install the archive of a host as its page says: unpack it into the host's folder."""

import zipfile
from pathlib import Path

from tools.host_archives import build_comfyui, build_folder


def unpack(archive: Path, folder: Path) -> None:
    """Unpack an archive with the permissions that ``unzip`` restores."""
    with zipfile.ZipFile(archive) as file:
        file.extractall(folder)
        for entry in file.infolist():
            (folder / entry.filename).chmod(entry.external_attr >> 16)


def install(host: str, folder: Path, downloads: Path) -> None:
    """Build the archive of a host in ``downloads`` and unpack it into the host's folder."""
    folder.mkdir(parents=True, exist_ok=True)
    unpack(build_comfyui(downloads, []) if host == "comfyui" else build_folder(host, downloads), folder)
