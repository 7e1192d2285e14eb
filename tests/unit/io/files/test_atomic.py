import os
import stat

import pytest

from bokehnet.errors import DataFileError, ImageFileError
from bokehnet.io.files.atomic import check_target, write_atomic


def test_the_file_appears_whole_and_no_temporary_file_stays(tmp_path):
    write_atomic(tmp_path / "a.json", lambda temporary: temporary.write_text("new"))
    assert [path.name for path in tmp_path.iterdir()] == ["a.json"]
    assert (tmp_path / "a.json").read_text() == "new"


def test_the_temporary_file_is_hidden_in_the_folder_of_the_target_with_its_extension(tmp_path):
    seen = []
    write_atomic(tmp_path / "a.exr", seen.append)
    assert seen[0].parent == tmp_path
    assert seen[0].name.startswith(".")
    assert seen[0].suffix == ".exr"


@pytest.mark.parametrize(
    "problem", [ValueError("bug"), KeyboardInterrupt(), OSError(28, "No space left on device")]
)
def test_a_crash_in_the_middle_keeps_the_older_file(tmp_path, problem):
    target = tmp_path / "a.txt"
    target.write_text("old")

    def write(temporary):
        temporary.write_text("half")
        raise problem

    with pytest.raises((ValueError, KeyboardInterrupt, ImageFileError)) as caught:
        write_atomic(target, write)
    assert target.read_text() == "old"
    assert os.listdir(tmp_path) == ["a.txt"]
    if isinstance(problem, OSError):
        assert isinstance(caught.value, ImageFileError)
        assert "a.txt" in str(caught.value)
        assert "No space left on device" in str(caught.value)
    else:
        assert caught.value is problem


def test_a_full_disk_raises_the_given_error_and_keeps_the_older_file(tmp_path, python_process):
    """A limit on the file size stands for the full disk: the kernel refuses the write in the same place."""
    target = tmp_path / "a.bin"
    target.write_bytes(b"old")
    source = """
import resource, sys
from bokehnet.errors import DataFileError
from bokehnet.io.files.atomic import write_atomic
resource.setrlimit(resource.RLIMIT_FSIZE, (1000, 1000))
try:
    write_atomic(sys.argv[1], lambda file: file.write_bytes(bytes(5000)), error=DataFileError)
except DataFileError as error:
    print(error)
"""
    outcome = python_process(source, target)
    assert outcome.code == 0, outcome.err
    assert "cannot be written" in outcome.out
    assert target.read_bytes() == b"old"
    assert os.listdir(tmp_path) == ["a.bin"]


def test_missing_room_is_found_before_anything_is_written(tmp_path, python_process):
    source = """
import resource, sys
from bokehnet.errors import ImageFileError
from bokehnet.io.files.atomic import write_atomic
resource.setrlimit(resource.RLIMIT_FSIZE, (1000, 1000))
try:
    write_atomic(sys.argv[1], lambda temporary: print("called"), room=2000)
except ImageFileError as error:
    print("refused")
"""
    assert python_process(source, tmp_path / "a.bin").out == "refused\n"
    assert os.listdir(tmp_path) == []


def test_the_mode_is_that_of_the_older_file_or_of_the_umask(tmp_path):
    def mode(path):
        return stat.S_IMODE(path.stat().st_mode)

    plain, target = tmp_path / "plain", tmp_path / "target"
    plain.write_text("")
    write_atomic(target, lambda temporary: None)
    assert mode(target) == mode(plain)
    target.chmod(0o600)
    write_atomic(target, lambda temporary: None)
    assert mode(target) == 0o600


def test_a_symbolic_link_is_followed(tmp_path):
    (tmp_path / "store").mkdir()
    link = tmp_path / "a.txt"
    link.symlink_to(tmp_path / "store" / "real.txt")
    write_atomic(link, lambda temporary: temporary.write_text("new"))
    assert link.is_symlink()
    assert (tmp_path / "store" / "real.txt").read_text() == "new"


def test_check_target_names_the_obstacle(tmp_path, monkeypatch):
    (tmp_path / "file").write_text("")
    for target, reason in (
        (tmp_path, "found a folder"),
        (tmp_path / "nowhere" / "a.png", "does not exist"),
        (tmp_path / "file" / "a.png", "is not a folder"),
    ):
        with pytest.raises(DataFileError, match=reason):
            check_target(target, error=DataFileError)
    monkeypatch.setattr(os, "access", lambda path, mode: False)  # permissions do not bind the superuser
    with pytest.raises(ImageFileError, match="not writable"):
        check_target(tmp_path / "a.png")


@pytest.mark.skipif(
    not hasattr(os, "geteuid") or os.geteuid() == 0, reason="permissions do not bind the superuser"
)
def test_a_folder_without_write_permission_is_refused(tmp_path):
    tmp_path.chmod(0o500)
    try:
        with pytest.raises(ImageFileError, match="not writable"):
            write_atomic(tmp_path / "a.txt", lambda temporary: None)
    finally:
        tmp_path.chmod(0o700)


def test_the_check_leaves_the_folder_as_it_is(tmp_path):
    (tmp_path / "a.txt").write_text("old")
    check_target(tmp_path / "a.txt")
    check_target(tmp_path / "b.txt")
    assert os.listdir(tmp_path) == ["a.txt"]
    assert (tmp_path / "a.txt").read_text() == "old"


@pytest.mark.skipif(not os.path.isdir("/proc/self"), reason="needs the file system of processes")
def test_the_check_refuses_a_folder_in_which_nobody_can_create_files():
    """Permission bits allow it to root in /proc; the kernel does not."""
    with pytest.raises(ImageFileError, match=r"^/proc/a.txt: the folder /proc is not writable: "):
        check_target("/proc/a.txt")


def test_the_check_follows_a_link_as_the_write_does(tmp_path):
    (tmp_path / "link.txt").symlink_to(tmp_path / "nowhere" / "a.txt")
    with pytest.raises(ImageFileError, match=r"link.txt: the folder .*nowhere is not writable"):
        check_target(tmp_path / "link.txt")
