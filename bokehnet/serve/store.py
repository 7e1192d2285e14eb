"""Jobs in a folder: accepted once, claimed by one worker at a time, finished once.

::

    queue/ID            marks a job that is not finished
    keys/HASH           the job of an idempotency key
    jobs/ID/request.json, input files
    jobs/ID/claim-N     the N-th worker that took it; its time is a heartbeat
    jobs/ID/free-N      that worker is dead: another may take it
    jobs/ID/progress.json
    jobs/ID/result-N.EXT
    jobs/ID/outcome.json

Every step is one atomic operation of the file system: a job appears by a rename, is claimed by making a file
that must not exist, and is finished by a link that must not exist. So whatever is killed in between, of
several services that share the folder, too, no job is lost and none has two outcomes.
"""

import contextlib
import fcntl
import hashlib
import json
import os
import secrets
import shutil
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

__all__ = ["Claim", "JobStore", "QueueFull"]

# Seconds without a heartbeat after which a claim's service is taken for dead.
STALE = 15.0


class QueueFull(Exception):  # noqa: N818
    """As many jobs are unfinished as may be."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Claim:
    """A job in the hands of a worker: its folder, and the number of this claim on it, from 1 up."""

    job: str
    folder: Path
    number: int

    @property
    def mark(self) -> Path:
        """The file that says so."""
        return self.folder / f"claim-{self.number}"

    @property
    def created(self) -> float:
        """When the job was accepted, seconds since the epoch."""
        return int(self.job.partition("-")[0], 16) / 1e9


class JobStore:
    """The jobs of a folder.

    Args:
        folder: Made if it is not there.
        most: Unfinished jobs at most.
        keep: Seconds for which finished jobs stay.
    """

    def __init__(self, folder: Path, most: int, keep: float) -> None:
        self.folder, self._most, self._keep = folder, most, keep
        for name in ("queue", "keys", "jobs", "incoming"):
            (folder / name).mkdir(parents=True, exist_ok=True)

    def incoming(self) -> Path:
        """Return a new folder for the files of a request that is still coming."""
        folder = self.folder / "incoming" / secrets.token_hex(8)
        folder.mkdir()
        return folder

    def submit(self, incoming: Path, request: dict[str, Any], key: str | None) -> tuple[str, bool]:
        """Accept a job, or find the one that the same key has brought before.

        Args:
            incoming: Its files; moved, or removed where the job is known.
            request: What is asked for, with ``owner`` and ``fingerprint``.
            key: Idempotency key of the client; None for none.

        Returns:
            The job's name, and whether it is new.

        Raises:
            QueueFull: Too many are unfinished.
        """
        mark = None
        if key is not None:
            mark = self.folder / "keys" / hashlib.sha256(f"{request['owner']}\0{key}".encode()).hexdigest()
        with self._locked():
            job = None
            if mark is not None and mark.exists():
                job = mark.read_text()
                if (self.folder / "jobs" / job).is_dir():
                    shutil.rmtree(incoming)
                    return job, False
            if len(os.listdir(self.folder / "queue")) >= self._most:
                raise QueueFull
            job = job or f"{time.time_ns():016x}-{secrets.token_hex(12)}"
            if mark is not None:
                _write(mark, job)
            _write(incoming / "request.json", json.dumps(request | {"created": time.time()}))
            (self.folder / "queue" / job).touch()
            os.rename(incoming, self.folder / "jobs" / job)
        return job, True

    def claim(self) -> Claim | None:
        """Take the oldest job that nobody has, or whose worker is dead; None where there is none."""
        for job in sorted(os.listdir(self.folder / "queue")):
            folder = self.folder / "jobs" / job
            if (folder / "outcome.json").exists() or not folder.exists():
                self._forget(job, folder)
                continue
            number = claims_of(folder)
            if number and not (folder / f"free-{number}").exists() and not _stale(folder / f"claim-{number}"):
                continue
            claim = Claim(job=job, folder=folder, number=number + 1)
            try:
                claim.mark.open("x").close()
            except (FileExistsError, FileNotFoundError):
                continue
            return claim
        return None

    def beat(self, claim: Claim, progress: dict[str, Any] | None = None) -> bool:
        """Say that a claim lives, and how far it is; return whether its client still wants it."""
        with contextlib.suppress(OSError):
            os.utime(claim.mark)
            if progress is not None:
                _write(claim.folder / "progress.json", json.dumps(progress), durable=False)
        return not (claim.folder / "outcome.json").exists()

    def release(self, claim: Claim) -> None:
        """Give a job back whose worker has died."""
        with contextlib.suppress(FileNotFoundError):  # cancelled and removed meanwhile
            (claim.folder / f"free-{claim.number}").touch()

    def finish(self, claim: Claim | str, outcome: dict[str, Any]) -> bool:
        """Write how a job ended; False where it had ended before, and nothing changes then."""
        job = claim if isinstance(claim, str) else claim.job
        folder = self.folder / "jobs" / job
        draft = folder / f"outcome-{secrets.token_hex(4)}"
        try:
            _write(draft, json.dumps(outcome | {"finished": time.time()}))
            os.link(draft, folder / "outcome.json")
        except (FileExistsError, FileNotFoundError):
            return False
        finally:
            draft.unlink(missing_ok=True)
        (self.folder / "queue" / job).unlink(missing_ok=True)
        return True

    def view(self, job: str) -> dict[str, Any] | None:
        """Return what is known of a job; None where there is none of that name."""
        folder = self.folder / "jobs" / job
        if "/" in job or job.startswith(".") or not (folder / "request.json").is_file():
            return None
        request = json.loads((folder / "request.json").read_text())
        claims = claims_of(folder)
        told: dict[str, Any] = {
            "id": job,
            "state": "running" if claims and not (folder / f"free-{claims}").exists() else "queued",
            "owner": request["owner"],
            "fingerprint": request["fingerprint"],
            "created": request["created"],
            "attempts": claims,
            "progress": _read(folder / "progress.json") or {"stage": "waiting", "share": 0.0},
        }
        return told | (_read(folder / "outcome.json") or {})

    def file(self, job: str, name: str) -> Path:
        """Return the path of a job's file."""
        return self.folder / "jobs" / job / name

    def unfinished(self) -> tuple[int, int]:
        """Return how many jobs wait and how many are in hand."""
        states = [view["state"] for job in os.listdir(self.folder / "queue") if (view := self.view(job))]
        return states.count("queued"), states.count("running")

    def remove(self, job: str) -> None:
        """Remove a finished job and its files."""
        shutil.rmtree(self.folder / "jobs" / job, ignore_errors=True)

    def clean(self) -> None:
        """Remove what was finished long ago, and uploads that nobody goes on with."""
        now = time.time()
        for entry in os.scandir(self.folder / "jobs"):
            with contextlib.suppress(OSError):
                if now - (Path(entry.path) / "outcome.json").stat().st_mtime > self._keep:
                    self.remove(entry.name)
        for name, old in (("keys", 2 * self._keep), ("incoming", 3600.0)):
            for entry in os.scandir(self.folder / name):
                with contextlib.suppress(OSError):
                    if now - entry.stat().st_mtime > old:
                        if entry.is_dir():
                            shutil.rmtree(entry.path, ignore_errors=True)
                        elif not (self.folder / "jobs" / Path(entry.path).read_text()).exists():
                            os.unlink(entry.path)

    @contextlib.contextmanager
    def _locked(self) -> Iterator[None]:
        """One at a time, of all processes; a killed one lets go."""
        with (self.folder / "lock").open("a") as file:
            fcntl.flock(file, fcntl.LOCK_EX)
            yield

    def _forget(self, job: str, folder: Path) -> None:
        """Take away the mark of a job that is finished, or whose service died before it was there."""
        mark = self.folder / "queue" / job
        with contextlib.suppress(OSError):
            if folder.exists() or time.time() - mark.stat().st_mtime > STALE:
                mark.unlink()


def claims_of(folder: Path) -> int:
    """How often a job was taken."""
    with contextlib.suppress(FileNotFoundError):
        return max((int(name[6:]) for name in os.listdir(folder) if name.startswith("claim-")), default=0)
    return 0


def _stale(mark: Path) -> bool:
    try:
        return time.time() - mark.stat().st_mtime > STALE
    except FileNotFoundError:
        return False


def _write(path: Path, text: str, *, durable: bool = True) -> None:
    """Write a small file in one step."""
    draft = path.with_name(f".{secrets.token_hex(6)}")
    with draft.open("w") as file:
        file.write(text)
        if durable:
            file.flush()
            os.fsync(file.fileno())
    os.replace(draft, path)


def _read(path: Path) -> dict[str, Any] | None:
    try:
        told: dict[str, Any] = json.loads(path.read_text())
    except FileNotFoundError:
        return None
    return told
