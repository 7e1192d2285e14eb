"""What a service can be told: address, folder, limits."""

from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

from bokehnet.settings.fields import Group, parse_bytes, setting

__all__ = ["ServiceSettings"]


def _hosts(text: str) -> tuple[str, ...]:
    return tuple(part.strip().lower() for part in text.split(",") if part.strip())


@dataclass(frozen=True, kw_only=True, slots=True)
class ServiceSettings(Group):
    """How a service listens, what it accepts, and what a job may take.

    Examples:
        >>> ServiceSettings(workers=2).queue
        32
    """

    GROUP: ClassVar[str] = "serve"
    TITLE: ClassVar[str] = "Service"

    host: str = setting("127.0.0.1", "Address to listen on; any but this machine's own needs --tokens.")
    port: int = setting(8000, "Port to listen on; 0 takes a free one.", low=0, high=65535)
    folder: Path = setting(
        Path("bokehnet-jobs"), "Where jobs and results are kept; services that share it share the work."
    )
    tokens: Path | None = setting(
        None, "File with a line NAME:TOKEN for each client; without it all may ask.", metavar="FILE"
    )
    workers: int = setting(1, "Processes that render, with their share of the cores each.", low=0, high=256)
    queue: int = setting(32, "Unfinished jobs at most; more are answered with 429.", low=1, high=100_000)
    max_pixels: int = setting(50_000_000, "Pixels of a picture at most.", unit="pixels", low=1)
    max_upload: int = setting(
        256 * 2**20, "Bytes of a request at most, such as 256M.", unit="bytes", parse=parse_bytes, low=1
    )
    time_limit: float = setting(300.0, "What a job may take once it is begun.", unit="s", above=0)
    memory_limit: int = setting(
        4 * 2**30, "What a worker may take, such as 4G; larger pictures are rendered in strips.",
        unit="bytes",
        parse=parse_bytes,
        low=640 * 2**20,
    )  # fmt: skip
    keep: float = setting(3600.0, "How long finished jobs are kept.", unit="s", above=0)
    patience: float = setting(30.0, "How long a client may send nothing while it uploads.", unit="s", above=0)
    drain: float = setting(60.0, "How long running jobs may take after SIGTERM.", unit="s", low=0)
    fetch_from: tuple[str, ...] | None = setting(
        None,
        "Hosts whose https addresses clients may give in place of an upload, joined by commas; default none.",
        metavar="HOSTS",
        parse=_hosts,
    )
