"""Jobs in a folder: accepted once, claimed by one worker at a time, finished once.

::

    queue/ID            marks an unfinished job
    keys/HASH           name of the job of an idempotency key
    jobs/ID/request.json, input files
    jobs/ID/claim-N     N-th claim by a worker; its modification time is the heartbeat
    jobs/ID/free-N      the worker of claim N is dead: another may claim the job
    jobs/ID/progress.json
    jobs/ID/result-N.EXT
    jobs/ID/outcome.json

Every step is one atomic operation of the file system: a rename creates a job, creation of a new file claims
it, and creation of a new link finishes it. So no job is lost and none has two outcomes, whichever process is
killed in between, even if several services share the folder.
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

# Seconds without a heartbeat after which the service of a claim counts as dead.
STALE_SECONDS = 15.0


class QueueFull(Exception):  # noqa: N818
    """Raised if the maximum number of unfinished jobs is reached."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Claim:
    """A claimed job: its folder, and the number of the claim, from 1."""

    job: str
    folder: Path
    number: int

    @property
    def mark(self) -> Path:
        """File that marks the claim."""
        return self.folder / f"claim-{self.number}"

    @property
    def created(self) -> float:
        """Time of acceptance, seconds since the epoch."""
        return int(self.job.partition("-")[0], 16) / 1e9


class JobStore:
    """Jobs of a folder.

    Args:
        folder: Folder of the jobs; created if absent.
        max_unfinished: Maximum number of unfinished jobs.
        keep: Time for which finished jobs are kept, s.
    """

    def __init__(self, folder: Path, max_unfinished: int, keep: float) -> None:
        self.folder, self._max_unfinished, self._keep = folder, max_unfinished, keep
        for name in ("queue", "keys", "jobs", "incoming"):
            (folder / name).mkdir(parents=True, exist_ok=True)

    def incoming(self) -> Path:
        """Create and return a folder for the files of an incoming request."""
        folder = self.folder / "incoming" / secrets.token_hex(8)
        folder.mkdir()
        return folder

    def submit(self, incoming: Path, request: dict[str, Any], key: str | None) -> tuple[str, bool]:
        """Accept a job, or return the existing job of the same key.

        Args:
            incoming: Folder of its files; moved, or removed if the job exists.
            request: Request with ``owner`` and ``fingerprint``.
            key: Idempotency key of the client, or None.

        Returns:
            Name of the job, and whether it is new.

        Raises:
            QueueFull: Too many jobs are unfinished.
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
            if len(os.listdir(self.folder / "queue")) >= self._max_unfinished:
                raise QueueFull
            job = job or f"{time.time_ns():016x}-{secrets.token_hex(12)}"
            if mark is not None:
                _write(mark, job)
            _write(incoming / "request.json", json.dumps(request | {"created": time.time()}))
            (self.folder / "queue" / job).touch()
            os.rename(incoming, self.folder / "jobs" / job)
        return job, True

    def claim(self) -> Claim | None:
        """Claim the oldest job that is unclaimed, or whose worker is dead; return None if there is none."""
        for job in sorted(os.listdir(self.folder / "queue")):
            folder = self.folder / "jobs" / job
            if (folder / "outcome.json").exists() or not folder.exists():
                self._forget(job, folder)
                continue
            number = _claim_count(folder)
            if number and not (folder / f"free-{number}").exists() and not _stale(folder / f"claim-{number}"):
                continue
            claim = Claim(job=job, folder=folder, number=number + 1)
            try:
                claim.mark.open("x").close()
            except (FileExistsError, FileNotFoundError):
                continue
            return claim
        return None

    def heartbeat(self, claim: Claim, progress: dict[str, Any] | None = None) -> bool:
        """Renew a claim and store its progress; return whether the job is still unfinished."""
        with contextlib.suppress(OSError):
            os.utime(claim.mark)
            if progress is not None:
                _write(claim.folder / "progress.json", json.dumps(progress), durable=False)
        return not (claim.folder / "outcome.json").exists()

    def release(self, claim: Claim) -> None:
        """Release the job of a dead worker."""
        with contextlib.suppress(FileNotFoundError):  # cancelled and removed in the meantime
            (claim.folder / f"free-{claim.number}").touch()

    def finish(self, claim: Claim | str, outcome: dict[str, Any]) -> bool:
        """Store the outcome of a job; return False without changes if it had one already."""
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
        """Return the state of a job; None if it does not exist."""
        folder = self.folder / "jobs" / job
        if "/" in job or job.startswith(".") or not (folder / "request.json").is_file():
            return None
        request = json.loads((folder / "request.json").read_text())
        claims = _claim_count(folder)
        state: dict[str, Any] = {
            "id": job,
            "state": "running" if claims and not (folder / f"free-{claims}").exists() else "queued",
            "owner": request["owner"],
            "fingerprint": request["fingerprint"],
            "created": request["created"],
            "attempts": claims,
            "progress": _read(folder / "progress.json") or {"stage": "waiting", "share": 0.0},
        }
        return state | (_read(folder / "outcome.json") or {})

    def file(self, job: str, name: str) -> Path:
        """Return the path of a job's file."""
        return self.folder / "jobs" / job / name

    def unfinished(self) -> tuple[int, int]:
        """Return the numbers of waiting and running jobs."""
        states = [view["state"] for job in os.listdir(self.folder / "queue") if (view := self.view(job))]
        return states.count("queued"), states.count("running")

    def remove(self, job: str) -> None:
        """Remove a finished job and its files."""
        shutil.rmtree(self.folder / "jobs" / job, ignore_errors=True)

    def clean(self) -> None:
        """Remove expired finished jobs, and abandoned uploads."""
        now = time.time()
        for entry in os.scandir(self.folder / "jobs"):
            with contextlib.suppress(OSError):
                if now - (Path(entry.path) / "outcome.json").stat().st_mtime > self._keep:
                    self.remove(entry.name)
        for name, max_age in (("keys", 2 * self._keep), ("incoming", 3600.0)):
            for entry in os.scandir(self.folder / name):
                with contextlib.suppress(OSError):
                    if now - entry.stat().st_mtime > max_age:
                        if entry.is_dir():
                            shutil.rmtree(entry.path, ignore_errors=True)
                        elif not (self.folder / "jobs" / Path(entry.path).read_text()).exists():
                            os.unlink(entry.path)

    @contextlib.contextmanager
    def _locked(self) -> Iterator[None]:
        """Hold the lock of the folder, across processes; the system releases it if the process is killed."""
        with (self.folder / "lock").open("a") as file:
            fcntl.flock(file, fcntl.LOCK_EX)
            yield

    def _forget(self, job: str, folder: Path) -> None:
        """Remove the queue mark of a job that is finished, or whose service died while creating it."""
        mark = self.folder / "queue" / job
        with contextlib.suppress(OSError):
            if folder.exists() or time.time() - mark.stat().st_mtime > STALE_SECONDS:
                mark.unlink()


def _claim_count(folder: Path) -> int:
    """Return the number of claims on a job."""
    with contextlib.suppress(FileNotFoundError):
        return max((int(name[6:]) for name in os.listdir(folder) if name.startswith("claim-")), default=0)
    return 0


def _stale(mark: Path) -> bool:
    try:
        return time.time() - mark.stat().st_mtime > STALE_SECONDS
    except FileNotFoundError:
        return False


def _write(path: Path, text: str, *, durable: bool = True) -> None:
    """Write a small file atomically."""
    draft = path.with_name(f".{secrets.token_hex(6)}")
    with draft.open("w") as file:
        file.write(text)
        if durable:
            file.flush()
            os.fsync(file.fileno())
    os.replace(draft, path)


def _read(path: Path) -> dict[str, Any] | None:
    try:
        table: dict[str, Any] = json.loads(path.read_text())
    except FileNotFoundError:
        return None
    return table
