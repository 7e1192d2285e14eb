"""Pictures by their address: from https alone, from hosts that are allowed, and no further."""

import hashlib
import shutil
import socket
import ssl
import subprocess
import threading
from http.server import BaseHTTPRequestHandler, HTTPServer

import pytest

from bokehnet.errors import ParameterError
from bokehnet.serve.http.uploads import fetch_url
from bokehnet.serve.problems import Problem

CONTENT = bytes(range(256)) * 40


class Pictures(BaseHTTPRequestHandler):
    """/a.png is a picture, /away leads to another host, all else is not there."""

    def log_message(self, *words):
        pass

    def do_GET(self):
        if self.path.startswith("/a.png"):
            self.send_response(200)
            self.end_headers()  # without its length, which a hostile server would not tell
            self.wfile.write(CONTENT)
        elif self.path == "/away":
            self.send_response(302)
            self.send_header("Location", "https://127.0.0.1/a.png")
            self.end_headers()
        else:
            self.send_error(404)


@pytest.fixture
def address(tmp_path, monkeypatch):
    """A server on this machine with a certificate that this process trusts."""
    openssl = shutil.which("openssl")
    if openssl is None:
        pytest.skip("needs openssl, which makes a certificate")
    key, certificate = tmp_path / "key.pem", tmp_path / "certificate.pem"
    command = [openssl, "req", "-x509", "-newkey", "rsa:2048", "-nodes", "-keyout", str(key), "-days", "2"]
    command += ["-out", str(certificate), "-subj", "/CN=localhost", "-addext", "subjectAltName=DNS:localhost"]
    subprocess.run(command, check=True, capture_output=True)
    monkeypatch.setenv("SSL_CERT_FILE", str(certificate))
    monkeypatch.setenv("no_proxy", "localhost")
    server = HTTPServer(("127.0.0.1", 0), Pictures)
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.load_cert_chain(certificate, key)
    server.socket = context.wrap_socket(server.socket, server_side=True)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    yield f"https://localhost:{server.server_address[1]}"
    server.shutdown()
    server.server_close()


def test_a_signed_address_of_an_allowed_host_is_fetched(address, tmp_path):
    digest = fetch_url(
        f"{address}/a.png?signature=1", (address.removeprefix("https://"),), tmp_path / "a.png", 20_000, 5
    )
    assert (tmp_path / "a.png").read_bytes() == CONTENT
    assert digest == hashlib.sha256(CONTENT).hexdigest()


def test_more_bytes_than_allowed_are_not_read(address, tmp_path):
    with pytest.raises(Problem, match="expected at most 5000 bytes") as error:
        fetch_url(f"{address}/a.png", (address.removeprefix("https://"),), tmp_path / "a.png", 5000, 5)
    assert error.value.status == 413


@pytest.mark.parametrize(("path", "words"), [("/away", "302"), ("/none.png", "404")])
def test_what_is_not_there_or_leads_away_is_a_problem(address, tmp_path, path, words, caplog):
    with pytest.raises(Problem, match="image_url: cannot be read"):
        fetch_url(f"{address}{path}", (address.removeprefix("https://"),), tmp_path / "a.png", 5000, 5)
    assert words in caplog.text


@pytest.mark.parametrize(
    "wrong",
    [
        "http://localhost/a.png",
        "file:///etc/passwd",
        "https://169.254.169.254/",
        "https://localhost.example.org/a.png",
        "https://localhost@example.org/a.png",
        "https://localhost:22/a.png",
        "https://localhost:99999/a.png",
        "a.png",
    ],
)
def test_another_address_is_refused_unasked(tmp_path, wrong):
    with pytest.raises(ParameterError, match="begins with one of: https://localhost/"):
        fetch_url(wrong, ("localhost",), tmp_path / "a.png", 5000, 5)
    assert list(tmp_path.iterdir()) == []


def test_failures_do_not_describe_the_network(address, tmp_path):
    """A closed port, an open one that speaks no TLS, and a missing file give the same answer."""
    with socket.socket() as silent, socket.socket() as closed:
        silent.bind(("127.0.0.1", 0))
        silent.listen()
        closed.bind(("127.0.0.1", 0))
        ports = [silent.getsockname()[1], closed.getsockname()[1]]
        places = [f"https://localhost:{port}" for port in ports] + [address]
        answers = set()
        for place in places:
            with pytest.raises(Problem) as caught:
                fetch_url(f"{place}/none.png", (place.removeprefix("https://"),), tmp_path / "a.png", 5000, 1)
            answers.add((caught.value.status, caught.value.detail))
    assert len(answers) == 1
