"""Jobs in a folder, whatever is killed: each step is looked at from a second store, as after a restart."""

import os
import threading

import pytest

from bokehnet.serve.jobs import store as stores
from bokehnet.serve.jobs.store import JobStore, QueueFull

REQUEST = {"owner": "", "fingerprint": "f"}


@pytest.fixture
def store(tmp_path):
    return JobStore(tmp_path, max_unfinished=3, keep=100.0)


def submit(store, key=None, **request):
    return store.submit(store.incoming(), REQUEST | request, key)


def test_a_job_is_claimed_by_one_and_in_order(store, tmp_path):
    jobs = [submit(store)[0] for _ in range(3)]
    other = JobStore(tmp_path, max_unfinished=3, keep=100.0)
    claims = [store.claim(), other.claim(), store.claim()]
    assert [claim.job for claim in claims] == jobs
    assert (store.claim(), other.claim()) == (None, None)


def test_many_at_once_never_claim_the_same(tmp_path):
    store = JobStore(tmp_path, max_unfinished=60, keep=100.0)
    jobs = {submit(store)[0] for _ in range(40)}
    results, lock = [], threading.Lock()

    def claim():
        mine = JobStore(tmp_path, max_unfinished=60, keep=100.0)
        while (claim := mine.claim()) is not None:
            with lock:
                results.append(claim.job)

    threads = [threading.Thread(target=claim) for _ in range(6)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(results) == 40
    assert set(results) == jobs


def test_a_job_has_one_outcome(store):
    submit(store)
    first = store.claim()
    store.release(first)
    second = store.claim()
    assert second.number == 2
    assert store.finish(second, {"state": "done", "result": "result-2.png"})
    assert not store.finish(first, {"state": "done", "result": "result-1.png"})
    assert store.view(first.job)["result"] == "result-2.png"
    assert store.unfinished() == (0, 0)


def test_the_job_of_a_dead_service_is_taken_by_another(store, tmp_path, monkeypatch):
    submit(store)
    lost = store.claim()
    other = JobStore(tmp_path, max_unfinished=3, keep=100.0)
    assert other.claim() is None  # its service lives: the heartbeat is fresh
    os.utime(lost.mark, (1, 1))
    again = other.claim()
    assert (again.job, again.number) == (lost.job, 2)
    assert store.heartbeat(lost)  # too late, but harmless
    assert other.finish(again, {"state": "done"})
    assert not store.heartbeat(lost)


def test_a_full_queue_takes_no_more_until_one_has_ended(store):
    for _ in range(3):
        submit(store)
    with pytest.raises(QueueFull):
        submit(store)
    store.finish(store.claim(), {"state": "done"})
    assert submit(store)[1]


def test_a_key_brings_its_job_even_when_the_queue_is_full(store):
    job, new = submit(store, "k")
    assert new
    for _ in range(2):
        submit(store)
    assert submit(store, "k") == (job, False)
    with pytest.raises(QueueFull):
        submit(store, "k", owner="another client")
    assert os.listdir(store.folder / "incoming") == [os.listdir(store.folder / "incoming")[0]]


def test_a_kill_between_key_and_job_makes_no_second_job(store, monkeypatch):
    def killed(*paths):
        raise KeyboardInterrupt

    monkeypatch.setattr(stores.os, "rename", killed)
    with pytest.raises(KeyboardInterrupt):
        submit(store, "k")
    monkeypatch.undo()
    assert store.claim() is None  # a mark without a job
    job, new = submit(store, "k")
    assert new
    assert os.listdir(store.folder / "queue") == [job] == os.listdir(store.folder / "jobs")


def test_finished_jobs_go_after_a_while_and_others_stay(tmp_path):
    store = JobStore(tmp_path, max_unfinished=3, keep=0.0)
    done, waiting = submit(store, "a")[0], submit(store, "b")[0]
    store.finish(store.claim(), {"state": "done"})
    store.clean()
    assert store.view(done) is None
    assert store.view(waiting)["state"] == "queued"


@pytest.mark.parametrize("name", ["../jobs", ".", "", "nothing", "a/b"])
def test_an_invalid_name_has_no_match(store, name):
    submit(store)
    assert store.view(name) is None


def damage(path):
    """Change a byte in the middle of a file."""
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 1
    path.write_bytes(data)


@pytest.mark.parametrize("name", ["request.json", "outcome.json"])
def test_a_damaged_job_is_detected_and_set_aside(store, name):
    bad, good = submit(store)[0], submit(store)[0]
    if name == "outcome.json":
        store.finish(bad, {"state": "done", "result": "result-1.png"})
    damage(store.folder / "jobs" / bad / name)
    if name == "request.json":
        assert store.claim().job == good
    for _ in range(2):
        with pytest.raises(stores.DamagedJob):
            store.view(bad)
    assert store.view(good)["state"] in ("queued", "running")
    assert (store.folder / "damaged" / bad / name).exists()
    assert bad not in os.listdir(store.folder / "queue")


@pytest.mark.parametrize("lost", ["outcome.json", "queue"])
@pytest.mark.parametrize("cleaned", [False, True])
def test_a_job_that_lost_its_end_or_its_mark_is_damaged(store, lost, cleaned):
    """Authority: a job is either marked as unfinished or has an outcome; otherwise it would wait for ever."""
    job, _ = submit(store)
    if lost == "queue":
        (store.folder / "queue" / job).unlink()
    else:
        store.finish(store.claim(), {"state": "done", "result": "result-1.png"})
        (store.folder / "jobs" / job / lost).unlink()
    if cleaned:
        store.clean()
        assert os.listdir(store.folder / "jobs") == []
    with pytest.raises(stores.DamagedJob):
        store.view(job)
    assert os.listdir(store.folder / "damaged") == [job]


def test_a_removed_job_is_never_half_there(store, monkeypatch):
    """Authority: a reader between any two steps of the removal finds the whole job, or none."""
    job, _ = submit(store)
    store.finish(store.claim(), {"state": "done"})
    views = []
    monkeypatch.setattr(stores.shutil, "rmtree", lambda *words, **more: views.append(store.view(job)))
    store.remove(job)
    assert views == [None]


def test_the_mark_of_a_job_that_is_just_created_stays(store, monkeypatch):
    """Authority: a claim that looks between the mark and the folder of a new job loses nothing."""
    created = []
    rename = os.rename
    monkeypatch.setattr(stores.os, "rename", lambda *places: (store.claim(), rename(*places)))
    forget = store._forget

    def forget_late(job, folder):
        monkeypatch.setattr(stores.os, "rename", rename)
        folder.mkdir()  # the folder appears after the look of the claim
        forget(job, folder)
        folder.rmdir()
        created.append(job)

    monkeypatch.setattr(store, "_forget", forget_late)
    job, _ = submit(store)
    assert created == [job] == os.listdir(store.folder / "queue")


@pytest.mark.parametrize("content", [b"", b"\0" * 50, b"[1]", b"{", b"{}", b"\xff{"])
def test_no_content_of_a_request_stops_other_jobs(store, content):
    bad, good = submit(store)[0], submit(store)[0]
    (store.folder / "jobs" / bad / "request.json").write_bytes(content)
    claims = [claim.job for claim in iter(store.claim, None)]
    assert good in claims
    with pytest.raises(stores.DamagedJob):
        store.view(bad)
    assert sum(store.unfinished()) == 1


def test_stray_files_are_ignored(store):
    job, _ = submit(store)
    folder = store.folder / "jobs" / job
    for name in ("claim-x", "claim-", "claim-1e9", "free-x", ".hidden", "claim-99999999999999999999"):
        (folder / name).touch()
    for place in ("queue", "jobs", "keys", "incoming"):
        (store.folder / place / "stray").write_bytes(b"\xff\0")
        (store.folder / place / "0123").mkdir()
    (store.folder / "queue" / ("0" * 16 + "-" + "a" * 24)).mkdir()
    claim = store.claim()
    assert (claim.job, claim.number) == (job, 1)
    store.clean()
    assert store.claim() is None
    assert store.unfinished() == (0, 1)


def test_a_file_in_place_of_a_job_stops_no_other(store):
    bad, good = submit(store)[0], submit(store)[0]
    folder = store.folder / "jobs" / bad
    folder.rename(store.folder / "elsewhere")
    folder.touch()
    assert store.claim().job == good


def test_a_damaged_key_still_finds_its_job(store):
    job, new = submit(store, key="k")
    (mark,) = (store.folder / "keys").iterdir()
    mark.write_bytes(b"\xff" * 41)
    assert new
    assert submit(store, key="k") == (job, False)


@pytest.mark.parametrize("job", ["a" * 300, "\ud800", "..", "a/b", "", "\0", "../../etc/passwd"])
def test_names_that_are_no_jobs_do_not_exist(store, job):
    assert store.view(job) is None


def test_jobs_are_private(store, tmp_path):
    job, _ = submit(store)
    folders = [store.folder / name for name in ("queue", "keys", "jobs", "incoming", "damaged")]
    assert {path.stat().st_mode & 0o777 for path in [*folders, store.folder / "jobs" / job]} == {0o700}
    assert (store.folder / "jobs" / job / "request.json").stat().st_mode & 0o777 == 0o600


def test_room_in_the_queue_is_checked_before_an_upload(store):
    for number in range(3):
        submit(store, key=str(number))
    with pytest.raises(QueueFull):
        store.check_room("", None)
    with pytest.raises(QueueFull):
        store.check_room("", "new")
    store.check_room("", "1")  # known: needs no room
