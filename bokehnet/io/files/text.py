"""Read text files: settings, presets, focus pulls, gains."""

from pathlib import Path

from bokehnet.errors import ConfigError

__all__ = ["read_text"]

_MAX_CHARACTERS = 16 * 2**20


def read_text(path: Path | str, kind: str = "", expected: str = "text", max_characters: int = -1) -> str:
    """Return the content of a text file with its line ends, without a byte-order mark.

    Args:
        path: Text file.
        kind: Kind of file, for the message.
        expected: Expected content, for the message.
        max_characters: Maximum number of characters to read; -1 reads all, up to 16 million.

    Raises:
        ConfigError: The file cannot be read, is too long, or is not UTF-8.
    """
    try:
        with Path(path).open(newline="", encoding="utf-8-sig") as file:
            text = file.read(max_characters if max_characters >= 0 else _MAX_CHARACTERS + 1)
    except OSError as error:
        name = f"{kind} {path}" if kind else str(path)
        raise ConfigError(f"cannot read {name}: {error.strerror or error}") from error
    except UnicodeDecodeError as error:
        raise ConfigError(f"{path}: expected {expected}, found an error: {error}") from error
    if len(text) > _MAX_CHARACTERS:
        raise ConfigError(f"{path}: expected {expected} of up to {_MAX_CHARACTERS} characters, found more")
    return text
