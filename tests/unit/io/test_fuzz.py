import os

SECONDS = float(os.environ.get("BOKEHNET_FUZZ_SECONDS", "0"))


def test_damaged_files_give_pictures_or_clean_errors(python_process):
    """Set BOKEHNET_FUZZ_SECONDS to go on for longer than one round."""
    source = f"from tests.unit.io.fuzz_readers import main; main({SECONDS})"
    outcome = python_process(source, timeout=SECONDS + 300)
    assert (outcome.code, outcome.out) == (0, ""), outcome.err[-4000:]
