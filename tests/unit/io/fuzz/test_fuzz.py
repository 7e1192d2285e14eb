import os

import pytest

SECONDS = float(os.environ.get("BOKEHNET_FUZZ_SECONDS", "0"))


def test_damaged_files_give_pictures_or_clean_errors(python_process):
    """Set BOKEHNET_FUZZ_SECONDS to go on for longer than one round."""
    source = f"from tests.unit.io.fuzz.fuzz_readers import main; main({SECONDS})"
    outcome = python_process(source, timeout=SECONDS + 300)
    assert (outcome.code, outcome.out) == (0, ""), outcome.err[-4000:]


@pytest.mark.skipif(not hasattr(os, "fork"), reason="each file is read in a forked process")
def test_unusual_files_give_pictures_or_clean_errors(python_process):
    """Each kind, whole and cut at four places; the module tries more as a command."""
    source = "from tests.unit.io.fuzz.fuzz_unusual import main; main(100, 3, cuts=4)"
    outcome = python_process(source)
    assert (outcome.code, outcome.out) == (0, ""), outcome.err[-4000:]
