"""Serve this folder on http://localhost:8000, with the headers that let WebAssembly use several threads."""

import argparse
import functools
import http.server
from pathlib import Path


class Handler(http.server.SimpleHTTPRequestHandler):
    """Files of one folder, isolated from other origins."""

    def end_headers(self) -> None:
        """Add the two headers that a browser asks for before it shares memory between threads."""
        self.send_header("Cross-Origin-Opener-Policy", "same-origin")
        self.send_header("Cross-Origin-Embedder-Policy", "require-corp")
        super().end_headers()


def main() -> None:
    """Serve until interrupted."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--port", type=int, default=8000)
    port = parser.parse_args().port
    handler = functools.partial(Handler, directory=Path(__file__).parent)
    http.server.ThreadingHTTPServer(("localhost", port), handler).serve_forever()


if __name__ == "__main__":
    main()
