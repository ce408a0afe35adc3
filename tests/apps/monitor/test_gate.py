import http.client
import http.server
import socket
import socketserver
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from readygo.apps.monitor.gate import Gate, Request, judge, parse_head
from readygo.common.errors import RunError

COOKIE = "readygo-monitor-1"


class Viewer(http.server.BaseHTTPRequestHandler):
    def do_GET(self) -> None:
        self.send_response(200)
        self.end_headers()
        self.wfile.write(b"page")

    def log_message(self, *_: object) -> None:
        pass


@pytest.fixture
def behind(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    # The name of a socket is short.
    monkeypatch.chdir(tmp_path)
    server = socketserver.ThreadingUnixStreamServer("viewer", Viewer)
    thread = threading.Thread(target=server.serve_forever)
    thread.start()
    yield Path("viewer")
    server.shutdown()
    thread.join()
    server.server_close()


def get(port: int, path: str = "/", **headers: str) -> tuple[int, dict[str, str], bytes]:
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=20)
    connection.request("GET", path, headers=headers)
    reply = connection.getresponse()
    found = reply.status, dict(reply.getheaders()), reply.read()
    connection.close()
    return found


def test_this_machine_is_let_in_by_its_own_name_alone() -> None:
    def answer(**headers: str) -> str:
        said = judge(Request("/", headers), "", COOKIE)
        return said.status if said else ""

    assert answer(host="localhost:80") == ""
    assert answer(host="[::1]:80") == ""
    assert answer(host="127.0.0.1:80", origin="http://127.0.0.1:80") == ""
    assert answer(host="127.0.0.1:80", origin="http://evil.example").startswith("403")
    assert answer(host="evil.example").startswith("403")
    assert answer().startswith("403")


@pytest.mark.parametrize("token", ["", "secret"])
@pytest.mark.parametrize("origin", ["null", "", "127.0.0.1:80", "ftp://127.0.0.1:80", "http://127.0.0.1", "http://["])
@pytest.mark.parametrize("host", [{"host": "127.0.0.1:80"}, {"host": ""}, {}])
def test_page_of_another_origin_is_refused_even_with_the_cookie(token: str, origin: str, host: dict[str, str]) -> None:
    answer = judge(Request("/", {"origin": origin, "cookie": f"{COOKIE}=secret", **host}), token, COOKIE)
    assert answer is not None
    assert answer.status.startswith("403")


@pytest.mark.parametrize("scheme", ["http", "https"])
def test_own_page_is_let_in_also_behind_a_proxy_with_tls(scheme: str) -> None:
    headers = {"host": "lab:80", "origin": f"{scheme}://lab:80", "cookie": f"{COOKIE}=secret"}
    assert judge(Request("/", headers), "secret", COOKIE) is None


def test_host_that_is_none_is_refused() -> None:
    answer = judge(Request("/", {"host": "[::1"}), "", COOKIE)
    assert answer is not None
    assert answer.status.startswith("403")


def test_head_that_is_none_is_refused() -> None:
    assert parse_head(b"hello\r\n\r\n") is None
    request = parse_head(b"GET /a?b=c HTTP/1.1\r\nHost: x\r\n\r\n")
    assert request == ("/a?b=c", {"host": "x"})


def test_token_comes_once_by_the_link_and_then_by_a_cookie(behind: Path) -> None:
    gate = Gate("127.0.0.1", 0, behind=behind, token="secret")
    status, _, body = get(gate.port)
    assert (status, b"token" in body) == (401, True)
    assert get(gate.port, "/?token=wrong")[0] == 401
    status, headers, _ = get(gate.port, "//evil.example/?token=secret&a=b")
    assert (status, headers["Location"]) == (303, "/?a=b"), "it never leads to another host"
    cookie = headers["Set-Cookie"]
    assert "HttpOnly" in cookie
    status, _, body = get(gate.port, Cookie=cookie.split(";")[0])
    assert (status, body) == (200, b"page")
    gate.close()


def test_a_viewer_that_is_gone_is_named(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    gate = Gate("127.0.0.1", 0, behind=tmp_path / "none")
    status, _, text = get(gate.port)
    gate.close()
    assert (status, text) == (502, b"The page's server does not answer; see the log.\n")
    assert "does not answer" in caplog.text


def test_a_browser_that_goes_away_disturbs_nobody(behind: Path) -> None:
    gate = Gate("127.0.0.1", 0, behind=behind)
    for _ in range(3):
        with socket.create_connection(("127.0.0.1", gate.port)) as browser:
            browser.sendall(b"GET / HT")
    assert get(gate.port)[::2] == (200, b"page")
    gate.close()


def test_port_in_use_says_so(behind: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as other, pytest.raises(RunError, match="another --host or --port"):
        Gate("127.0.0.1", other.getsockname()[1], behind=behind)


@pytest.mark.parametrize(
    ("name", "value"), [("Host", "[::1"), ("Host", "a]b"), ("Origin", "http://[::1"), ("Origin", "[")]
)
def test_addresses_that_are_none_are_refused_quietly(
    behind: Path, name: str, value: str, caplog: pytest.LogCaptureFixture
) -> None:
    for token in ("", "secret"):
        gate = Gate("127.0.0.1", 0, behind=behind, token=token)
        try:
            status, _, _ = get(gate.port, **{name: value})
        finally:
            gate.close()
        assert status in (400, 403)
    assert not caplog.records
    assert parse_head(b"GET //[::1 HTTP/1.1\r\nHost: localhost\r\n\r\n") is None
