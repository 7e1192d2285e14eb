"""Damaged and encrypted sessions, pictures without depth, and helpers at their limits."""

import json
import time
import zipfile

import numpy as np
import pytest

from bokehnet.errors import BokehnetError, ConfigError
from bokehnet.io.channels import write_channels
from bokehnet.processes.limits import limit_address_space, limit_cpu_time
from bokehnet.studio.background import BackgroundProcess
from bokehnet.studio.files.archive import read_session, write_session


@pytest.fixture
def saved(tmp_path, files):
    path = tmp_path / "a.bokeh"
    table = {"format": 1, "picture": "photo.png", "settings": {}, "strokes": []}
    write_session(path, table, {"photo.png": files / "photo.png"})
    return path


def test_every_damage_of_a_session_is_one_line_or_harmless(saved, tmp_path):
    """Each bit flip within the headers, and each of 50 cuts."""
    data = saved.read_bytes()
    expected = read_session(saved, tmp_path)
    rng = np.random.default_rng(0)
    starts = [index for index in range(len(data)) if data[index : index + 2] == b"PK"]
    headers = sorted({index for start in starts for index in range(start, min(start + 60, len(data)))})
    damaged = [(index, 1 << int(rng.integers(8))) for index in headers]
    versions = [data[:index] + bytes([data[index] ^ bit]) + data[index + 1 :] for index, bit in damaged]
    versions += [data[:end] for end in rng.integers(0, len(data), 50).tolist()]
    refused = 0
    for version in versions:
        saved.write_bytes(version)
        try:
            table = read_session(saved, tmp_path)
        except BokehnetError:  # its text is one line
            refused += 1
        else:
            assert table == expected
    assert refused > len(versions) // 2


def test_an_encrypted_session_is_refused(saved, tmp_path):
    data = bytearray(saved.read_bytes())
    for mark, offset in ((b"PK\x03\x04", 6), (b"PK\x01\x02", 8)):
        start = -1
        while (start := data.find(mark, start + 1)) >= 0:
            data[start + offset] |= 1
    saved.write_bytes(data)
    assert zipfile.ZipFile(saved).infolist()[0].flag_bits & 1
    with pytest.raises(ConfigError, match="without encryption"):
        read_session(saved, tmp_path)


def test_an_exr_without_depth_opens(client, tmp_path):
    values = np.random.default_rng(0).random((12, 16)).astype(np.float32)
    write_channels(tmp_path / "a.exr", dict.fromkeys("RGB", values))
    answer = client.post("api/open?name=a.exr", content=(tmp_path / "a.exr").read_bytes())
    assert (answer.status_code, answer.json()["open"]) == (200, True), answer.text
    damaged = (tmp_path / "a.exr").read_bytes()[:200]
    answer = client.post("api/open?name=b.exr", content=damaged)
    assert answer.status_code == 422
    assert "no such file" not in json.dumps(answer.json())


def map_memory(size, report):
    """Map ``size`` bytes behind a limit of 1 GB; run by the process."""
    limit_address_space(2**30)
    return len(np.empty(size, np.uint8))


def use_time(seconds, report):
    """Use processor time behind a limit of one second; run by the process."""
    limit_cpu_time(1)
    end = time.process_time() + seconds
    while time.process_time() < end:
        pass


@pytest.mark.slow
def test_a_helper_at_its_limits_fails_with_a_line_and_is_replaced():
    process = BackgroundProcess()
    try:
        with pytest.raises(BokehnetError, match="out of memory"):
            process.run(map_memory, 2**34)
        with pytest.raises(BokehnetError, match="died"):
            process.run(use_time, 30.0)
        assert process.run(map_memory, 1000) == 1000
    finally:
        process.stop()
