"""Pages of headless Chromium, and servers of their files."""

import functools
import http.server
import shutil
import threading
from contextlib import contextmanager

import pytest


def program(*names):
    """Path of the first of these programs that is installed; skip without any."""
    result = next(filter(None, map(shutil.which, names)), None)
    if result is None:
        pytest.skip(f"needs {' or '.join(names)}, which is not installed")
    return result


def served(folder, handler):
    """A server of this folder."""
    server = http.server.ThreadingHTTPServer(("localhost", 0), functools.partial(handler, directory=folder))
    threading.Thread(target=server.serve_forever, daemon=True).start()
    return server


@contextmanager
def opened(browser, **options):
    """A page with storage, cache and workers of its own."""
    context = browser.new_context(accept_downloads=True, **options)
    yield context.new_page()
    context.close()
