"""Text files: settings, presets, pulls, gains."""

from pathlib import Path

from bokehnet.errors import ConfigError

__all__ = ["read_text"]


def read_text(path: Path | str, what: str = "", expected: str = "text", longest: int = -1) -> str:
    """Return what a text file holds, line ends as they are, without a byte-order mark.

    Args:
        path: The file.
        what: Kind of file, for the message.
        expected: What it should hold, for the message.
        longest: Characters that are read at most; -1 reads all.

    Raises:
        ConfigError: It cannot be read, or is no UTF-8.
    """
    try:
        with Path(path).open(newline="", encoding="utf-8-sig") as file:
            return file.read(longest)
    except OSError as error:
        name = f"{what} {path}" if what else str(path)
        raise ConfigError(f"cannot read {name}: {error.strerror or error}") from error
    except UnicodeDecodeError as error:
        raise ConfigError(f"{path}: expected {expected}, found an error: {error}") from error
