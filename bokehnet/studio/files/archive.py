"""Session files: the picture, its depth, the settings and the strokes in one file.

A session file is a ZIP file without compression, so that reading it cannot expand to a larger size.
"""

import json
import zipfile
from pathlib import Path
from typing import Any

from bokehnet.errors import ConfigError, errors_of_file
from bokehnet.studio.files.uploads import MAX_BYTES, safe_name

__all__ = ["read_session", "write_session"]

_TABLE = "session.json"
_MAX_FILES = 8
_MAX_TABLE_BYTES = 4 * 2**20
_ENCRYPTED = 1  # flag of a file in an archive


def write_session(path: Path, table: dict[str, Any], files: dict[str, Path]) -> None:
    """Write a session file.

    Args:
        path: Output file.
        table: Content of the JSON part.
        files: Files by their names in the table.
    """
    with zipfile.ZipFile(path, "w", zipfile.ZIP_STORED) as archive:
        archive.writestr(_TABLE, json.dumps(table, indent=1))
        for name, file in files.items():
            archive.write(file, name)


def read_session(path: Path, folder: Path) -> dict[str, Any]:
    """Return the table of a session file, and extract its files into a folder.

    Raises:
        ConfigError: It is no session file, is damaged, or contains a compressed, encrypted or too large file,
            or an unsafe name.
    """
    with (
        errors_of_file("session", "a file saved by the studio", ConfigError),
        zipfile.ZipFile(path) as archive,
    ):
        entries = archive.infolist()
        if len(entries) > _MAX_FILES or sum(entry.file_size for entry in entries) > MAX_BYTES:
            raise ConfigError("expected a session of a few files, found a larger one")
        for entry in entries:
            if entry.flag_bits & _ENCRYPTED:
                raise ConfigError("expected a session without encryption, found an encrypted file in it")
            if entry.compress_type != zipfile.ZIP_STORED or entry.file_size != entry.compress_size:
                raise ConfigError("expected a session without compression, found a compressed file in it")
        if archive.getinfo(_TABLE).file_size > _MAX_TABLE_BYTES:
            raise ConfigError("expected a session of a few files, found a larger one")
        table = json.loads(archive.read(_TABLE))
        for entry in entries:
            if entry.filename != _TABLE:
                if safe_name(entry.filename) != entry.filename:
                    raise ConfigError("expected plain names in a session, found another")
                (folder / entry.filename).write_bytes(archive.read(entry))
    if not isinstance(table, dict):
        raise ConfigError("expected a session file saved by the studio, found something else")
    return table
