"""Settings of a service: address, folder, limits."""

from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

from bokehnet.settings.fields import Group, parse_bytes, setting

__all__ = ["ServiceSettings"]


def _hosts(text: str) -> tuple[str, ...]:
    return tuple(part.strip().lower() for part in text.split(",") if part.strip())


@dataclass(frozen=True, kw_only=True, slots=True)
class ServiceSettings(Group):
    """Address of a service, limits of requests, and limits of jobs.

    Examples:
        >>> ServiceSettings(workers=2).queue
        32
    """

    GROUP: ClassVar[str] = "serve"
    TITLE: ClassVar[str] = "Service"

    host: str = setting("127.0.0.1", "Address to listen on; any but a loopback address requires --tokens.")
    port: int = setting(8000, "Port to listen on; 0 selects a free one.", low=0, high=65535)
    folder: Path = setting(
        Path("bokehnet-jobs"), "Folder of jobs and results; services with the same folder share the work."
    )
    tokens: Path | None = setting(
        None,
        "File with a line NAME:TOKEN for each client; without it all requests are accepted.",
        metavar="FILE",
    )
    workers: int = setting(1, "Render processes, which divide the cores equally.", low=0, high=256)
    queue: int = setting(32, "Maximum unfinished jobs; others are rejected with 429.", low=1, high=100_000)
    max_pixels: int = setting(50_000_000, "Maximum pixels of a picture.", unit="pixels", low=1)
    max_upload: int = setting(
        256 * 2**20, "Maximum size of a request, such as 256M.", unit="bytes", parse=parse_bytes, low=1
    )
    time_limit: float = setting(300.0, "Maximum render time of a job.", unit="s", above=0)
    memory_limit: int = setting(
        4 * 2**30, "Maximum memory of a worker, such as 4G; larger pictures are rendered in strips.",
        unit="bytes",
        parse=parse_bytes,
        low=640 * 2**20,
    )  # fmt: skip
    keep: float = setting(3600.0, "Time for which finished jobs are kept.", unit="s", above=0)
    patience: float = setting(30.0, "Maximum pause of a client during an upload.", unit="s", above=0)
    drain: float = setting(60.0, "Time for running jobs to finish after SIGTERM.", unit="s", low=0)
    fetch_from: tuple[str, ...] | None = setting(
        None,
        "Hosts, NAME or NAME:PORT, whose https addresses clients may send instead of an upload, joined by "
        "commas; default none.",
        metavar="HOSTS",
        parse=_hosts,
    )
