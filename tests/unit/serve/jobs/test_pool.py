"""The pool when its folder cannot be written: jobs wait, workers go on. Authority: the store."""

import threading
import time

import pytest

pytest.importorskip("prometheus_client", reason="needs the extra serve")

from bokehnet.serve.jobs.pool import Pool
from bokehnet.serve.jobs.store import JobStore
from bokehnet.serve.metrics import Metrics
from bokehnet.serve.service_settings import ServiceSettings


class FullStore(JobStore):
    """A store on a disk that is full for a while."""

    fails = ()

    def _fail(self, name):
        if name in self.fails:
            self.reported.add(name)
            raise OSError(28, "No space left on device")

    def claim(self):
        self._fail("claim")
        return super().claim()

    def finish(self, claim, outcome):
        self._fail("finish")
        return super().finish(claim, outcome)

    def release(self, claim):
        self._fail("release")
        super().release(claim)


@pytest.mark.parametrize("fails", [("claim",), ("finish",), ("finish", "release")])
def test_a_full_disk_costs_no_job_and_no_worker(tmp_path, monkeypatch, fails):
    monkeypatch.setattr("bokehnet.serve.jobs.store.STALE_SECONDS", 2.0)
    store = FullStore(tmp_path, 10, 60.0)
    store.reported, store.fails = set(), fails
    pool = Pool(store, ServiceSettings(workers=1, folder=tmp_path), Metrics(store))
    incoming = store.incoming()
    request = {
        "owner": "",
        "fingerprint": "",
        "files": {"image": "none.png"},
        "format": "png",
        "settings": {},
    }
    job, _ = store.submit(incoming, request, None)
    pool.start()
    try:
        wait(lambda: store.reported == set(fails))
        assert all(thread.is_alive() for thread in threading.enumerate() if thread.name.startswith("slot-"))
        assert store.view(job)["state"] in ("queued", "running")
        store.fails = ()
        wait(lambda: store.view(job)["state"] == "failed")  # its picture is not there
        assert store.unfinished() == (0, 0)
    finally:
        pool.drain(5)


def wait(true, seconds=60):
    end = time.monotonic() + seconds
    while not true():
        assert time.monotonic() < end
        time.sleep(0.05)
