"""The machine code that the package ships was made from the sources that it ships."""

import json

from bokehnet.precompiled.library import (
    FORMAT,
    PACKAGE,
    PROCESSORS,
    digest,
    file_digest,
    library_file,
    table_file,
)

FOLDER = PACKAGE / "precompiled"
TABLE = json.loads(table_file(FOLDER).read_text("utf-8"))
REMEDY = "run python -m benchmarks.precompile"


def test_libraries_and_table_belong_together():
    assert TABLE["format"] == FORMAT, REMEDY
    found = {processor: file_digest(library_file(FOLDER, processor)) for processor in PROCESSORS}
    assert TABLE["libraries"] == found, REMEDY


def test_no_source_has_changed_since():
    """Else numba compiles these kernels: right, but the first picture waits for it."""
    changed = [source for source, stamp in TABLE["sources"].items() if digest(source) != stamp]
    assert changed == [], REMEDY


def test_no_library_names_a_folder_of_the_machine_that_made_it():
    """Files in it are named from the package's parent on."""
    for processor in PROCESSORS:
        code = library_file(FOLDER, processor).read_bytes()
        assert b"/bokehnet/classical/" in code
        assert b"site-packages" not in code
        assert str(PACKAGE).encode() not in code
