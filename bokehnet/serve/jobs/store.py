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
    damaged/ID          job whose files were damaged

Files with a JSON table begin with the checksum of the rest. A job with a damaged one is set aside, so that it
neither stops other jobs nor is answered wrongly. Files and folders with other names are ignored. Folders are
private to the user of the service.

Every step is one atomic operation of the file system: a rename creates a job, creation of a new file claims
it, and creation of a new link finishes it. So no job is lost and none has two outcomes, whichever process is
killed in between, even if several services share the folder.
"""

import contextlib
import fcntl
import hashlib
import json
import logging
import os
import re
import secrets
import shutil
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

__all__ = ["Claim", "DamagedJob", "JobStore", "QueueFull", "file_sha256", "read_table"]

_log = logging.getLogger(__name__)

_JOB = re.compile(r"[0-9a-f]{16}-[0-9a-f]{24}")
_CLAIM = re.compile(r"claim-([0-9]{1,9})")
_FOLDERS = ("queue", "keys", "jobs", "incoming", "damaged")

# Seconds without a heartbeat after which the service of a claim counts as dead.
STALE_SECONDS = 15.0

# Seconds for which damaged jobs are kept at least.
_MIN_DAMAGED_SECONDS = 7 * 86400.0


class QueueFull(Exception):  # noqa: N818
    """Raised if the maximum number of unfinished jobs is reached."""


class DamagedJob(Exception):  # noqa: N818
    """Raised if the files of a job are damaged."""


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
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        for name in _FOLDERS:
            (folder / name).mkdir(mode=0o700, exist_ok=True)
            (folder / name).chmod(0o700)

    def incoming(self) -> Path:
        """Create and return a folder for the files of an incoming request."""
        folder = self.folder / "incoming" / secrets.token_hex(8)
        folder.mkdir(mode=0o700)
        return folder

    def check_room(self, owner: str, key: str | None) -> None:
        """Raise ``QueueFull`` if a request would be rejected; call this before its files are received.

        Args:
            owner: Client.
            key: Idempotency key; the job of a known one needs no room.
        """
        if len(self._queued()) >= self._max_unfinished and not (
            key is not None and self._key_mark(owner, key).exists()
        ):
            raise QueueFull

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
        mark = None if key is None else self._key_mark(request["owner"], key)
        with self._locked():
            job = None
            if mark is not None and mark.exists():
                job = self._job_of(mark)
                if job is not None and (self.folder / "jobs" / job).is_dir():
                    shutil.rmtree(incoming)
                    return job, False
            if len(self._queued()) >= self._max_unfinished:
                raise QueueFull
            job = job or f"{time.time_ns():016x}-{secrets.token_hex(12)}"
            if mark is not None:
                _write(mark, job)
                request = request | {"key": mark.name}
            _write_table(incoming / "request.json", request | {"created": time.time()})
            (self.folder / "queue" / job).touch()
            os.rename(incoming, self.folder / "jobs" / job)
        return job, True

    def claim(self) -> Claim | None:
        """Claim the oldest job that is unclaimed, or whose worker is dead; return None if there is none."""
        for job in self._queued():
            folder = self.folder / "jobs" / job
            if (folder / "outcome.json").exists() or not folder.exists():
                self._forget(job, folder)
                continue
            try:
                number = _claim_count(folder)
                free = (folder / f"free-{number}").exists() or _stale(folder / f"claim-{number}")
                if number and not free:
                    continue
                read_table(folder / "request.json")
            except (DamagedJob, NotADirectoryError, IsADirectoryError, FileNotFoundError):
                self.set_aside(job)
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
                _write_table(claim.folder / "progress.json", progress, durable=False)
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
            _write_table(draft, outcome | {"finished": time.time()})
            os.link(draft, folder / "outcome.json")
        except (FileExistsError, FileNotFoundError):
            return False
        finally:
            draft.unlink(missing_ok=True)
        (self.folder / "queue" / job).unlink(missing_ok=True)
        return True

    def view(self, job: str) -> dict[str, Any] | None:
        """Return the state of a job; None if it does not exist.

        Raises:
            DamagedJob: Its files are damaged; it is set aside.
        """
        if not _JOB.fullmatch(job):
            return None
        folder = self.folder / "jobs" / job
        if (self.folder / "damaged" / job).exists():
            raise DamagedJob(job)
        if not folder.is_dir():
            return None
        try:
            request = _read(folder / "request.json")
            outcome = _read(folder / "outcome.json") or {}
            if request is None:
                raise DamagedJob(job)
            if not outcome and not self._is_queued(job):
                outcome = _read(folder / "outcome.json") or {}  # it may have ended in the meantime
                if not outcome:
                    raise DamagedJob(job)
            claims = _claim_count(folder)
            state: dict[str, Any] = {
                "id": job,
                "state": "running" if claims and not (folder / f"free-{claims}").exists() else "queued",
                "owner": request["owner"],
                "fingerprint": request["fingerprint"],
                "created": request["created"],
                "attempts": claims,
                "progress": self._progress(folder) or {"stage": "waiting", "share": 0.0},
            }
        except (DamagedJob, KeyError, IsADirectoryError, NotADirectoryError) as error:
            if not folder.is_dir():  # removed in the meantime
                return None
            self.set_aside(job)
            raise DamagedJob(job) from error
        return state | outcome

    def _is_queued(self, job: str) -> bool:
        """Return whether a job is marked as unfinished; one without mark and outcome has lost a file."""
        return (self.folder / "queue" / job).exists()

    def _progress(self, folder: Path) -> dict[str, Any] | None:
        """Return the progress of a job; None if it is missing or damaged."""
        try:
            return _read(folder / "progress.json")
        except (DamagedJob, OSError):
            return None

    def _queued(self) -> list[str]:
        """Return the unfinished jobs, oldest first."""
        return sorted(name for name in os.listdir(self.folder / "queue") if _JOB.fullmatch(name))

    def _key_mark(self, owner: str, key: str) -> Path:
        digest = hashlib.sha256(f"{owner}\0{key}".encode("utf-8", "surrogateescape"))
        return self.folder / "keys" / digest.hexdigest()

    def _job_of(self, mark: Path) -> str | None:
        """Return the job of an idempotency key; one whose file is damaged is searched among all jobs."""
        with contextlib.suppress(OSError, UnicodeDecodeError):
            job = mark.read_text()
            if _JOB.fullmatch(job):
                return job
        _log.error("%s is damaged", mark)
        for job in os.listdir(self.folder / "jobs"):
            with contextlib.suppress(OSError, DamagedJob):
                if read_table(self.folder / "jobs" / job / "request.json").get("key") == mark.name:
                    return job
        return None

    def set_aside(self, job: str) -> None:
        """Move a damaged job out of the way; its files stay for inspection."""
        _log.error("job %s: its files are damaged; moved to %s", job, self.folder / "damaged")
        with contextlib.suppress(OSError):
            os.rename(self.folder / "jobs" / job, self.folder / "damaged" / job)
        with contextlib.suppress(OSError):
            (self.folder / "queue" / job).unlink()

    def result_file(self, job: str, view: dict[str, Any]) -> Path:
        """Return the path of a finished job's picture.

        Raises:
            DamagedJob: The picture is missing, or its checksum is not that of the outcome; it is set aside.
        """
        path: Path = self.folder / "jobs" / job / view["result"]
        try:
            is_intact = file_sha256(path) == view["result_sha256"]
        except OSError:
            is_intact = False
        if not is_intact:
            self.set_aside(job)
            raise DamagedJob(job)
        return path

    def unfinished(self) -> tuple[int, int]:
        """Return the numbers of waiting and running jobs."""
        states = []
        for job in self._queued():
            with contextlib.suppress(DamagedJob):
                if view := self.view(job):
                    states.append(view["state"])
        return states.count("queued"), states.count("running")

    def remove(self, job: str) -> None:
        """Remove a finished job and its files; a reader sees all of them or none."""
        removed = self.folder / "incoming" / f"removed-{secrets.token_hex(8)}"
        with contextlib.suppress(OSError):
            os.rename(self.folder / "jobs" / job, removed)
            shutil.rmtree(removed, ignore_errors=True)

    def clean(self) -> None:
        """Remove expired finished jobs, and abandoned uploads; set jobs aside that lost a file."""
        now = time.time()
        for entry in os.scandir(self.folder / "jobs"):
            try:
                if now - (Path(entry.path) / "outcome.json").stat().st_mtime > self._keep:
                    self.remove(entry.name)
            except OSError:
                with contextlib.suppress(OSError, DamagedJob):
                    self.view(entry.name)
        damaged_age = max(self._keep, _MIN_DAMAGED_SECONDS)
        for name, max_age in (("keys", 2 * self._keep), ("incoming", 3600.0), ("damaged", damaged_age)):
            for entry in os.scandir(self.folder / name):
                with contextlib.suppress(OSError):
                    if now - entry.stat().st_mtime > max_age:
                        if entry.is_dir():
                            shutil.rmtree(entry.path, ignore_errors=True)
                        elif name != "keys" or not self._is_alive(Path(entry.path)):
                            os.unlink(entry.path)

    def _is_alive(self, mark: Path) -> bool:
        """Return whether the job of an idempotency key exists."""
        job = self._job_of(mark)
        return job is not None and (self.folder / "jobs" / job).exists()

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
            is_abandoned = not folder.exists() and time.time() - mark.stat().st_mtime > STALE_SECONDS
            if is_abandoned or (folder / "outcome.json").exists():  # not if it has just been created
                mark.unlink()


def _claim_count(folder: Path) -> int:
    """Return the number of claims on a job."""
    with contextlib.suppress(FileNotFoundError):
        marks = map(_CLAIM.fullmatch, os.listdir(folder))
        return max((int(mark[1]) for mark in marks if mark is not None), default=0)
    return 0


def _stale(mark: Path) -> bool:
    try:
        return time.time() - mark.stat().st_mtime > STALE_SECONDS
    except FileNotFoundError:
        return False


def _write(path: Path, text: str, *, durable: bool = True) -> None:
    """Write a small file atomically."""
    draft = path.with_name(f".{secrets.token_hex(6)}")
    with os.fdopen(os.open(draft, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "w") as file:
        file.write(text)
        if durable:
            file.flush()
            os.fsync(file.fileno())
    os.replace(draft, path)


def _write_table(path: Path, table: dict[str, Any], *, durable: bool = True) -> None:
    """Write a table as JSON behind its checksum."""
    text = json.dumps(table)
    _write(path, f"{hashlib.sha256(text.encode()).hexdigest()}\n{text}", durable=durable)


def file_sha256(path: Path) -> str:
    """Return the SHA-256 of a file's bytes."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def read_table(path: Path) -> dict[str, Any]:
    """Read a table written with its checksum, or one of an earlier version without.

    Raises:
        DamagedJob: The file is damaged.
        OSError: It cannot be read.
    """
    data = path.read_bytes()
    if not data.startswith(b"{"):
        checksum, _, data = data.partition(b"\n")
        if hashlib.sha256(data).hexdigest().encode() != checksum:
            raise DamagedJob(path.parent.name)
    try:
        table = json.loads(data)
    except (ValueError, RecursionError) as error:
        raise DamagedJob(path.parent.name) from error
    if not isinstance(table, dict):
        raise DamagedJob(path.parent.name)
    return table


def _read(path: Path) -> dict[str, Any] | None:
    """Return a table; None if the file does not exist."""
    try:
        return read_table(path)
    except FileNotFoundError:
        return None
