"""The server of the view: who may ask, what is answered, and what is printed."""

from __future__ import annotations

import http.client
import socket
import struct
import time
from collections.abc import Iterator

import pytest

from urdfcal.base.errors import UsageError
from urdfcal.output.view.server import PageServer, is_own_name

PAGE = b"<!DOCTYPE html><title>x</title>" + b"." * 4_000_000


@pytest.fixture(scope="module")
def server() -> Iterator[PageServer]:
    """A server on loopback."""
    with PageServer(PAGE, port=0) as opened:
        yield opened


def asked(server: PageServer, method: str = "GET", **headers: str) -> tuple[http.client.HTTPResponse, bytes]:
    """One request and its answer."""
    connection = http.client.HTTPConnection("127.0.0.1", server.port, timeout=10)
    connection.putrequest(method, "/", skip_host="Host" in headers)
    for name, value in headers.items():
        connection.putheader(name, value)
    connection.endheaders()
    answer = connection.getresponse()
    content = answer.read()
    connection.close()
    return answer, content


def raw(server: PageServer, request: bytes) -> bytes:
    """The answer to a request as bytes."""
    with socket.create_connection(("127.0.0.1", server.port), timeout=10) as connection:
        connection.sendall(request)
        parts = []
        while part := connection.recv(1 << 20):
            parts.append(part)
        return b"".join(parts)


def test_head_tells_the_size_and_sends_nothing(server: PageServer) -> None:
    """As GET does, without the page."""
    (head, nothing), (get, page) = asked(server, "HEAD"), asked(server)
    assert (head.status, nothing, get.status, page) == (200, b"", 200, PAGE)
    assert head.getheader("Content-Length") == get.getheader("Content-Length") == str(len(PAGE))


def test_a_name_that_was_made_to_lead_here_gets_nothing(server: PageServer) -> None:
    """A page elsewhere could read the robot otherwise; own names are answered at any port, since a tunnel may have another."""
    for name in ("evil.example", f"evil.example:{server.port}", "localhost.evil.example", "192.0.2.1", "127.0.0.1@evil.example", ""):
        answer, content = asked(server, Host=name)
        assert (answer.status, b"title" in content) == (421, False), name
    for name in ("localhost", "LOCALHOST:8000", "localhost.:80", f"127.0.0.1:{server.port}", "[::1]:7000"):
        assert asked(server, Host=name)[0].status == 200, name


def test_a_request_without_a_host_or_with_two_gets_nothing(server: PageServer) -> None:
    """No browser sends either."""
    for hosts in (b"", b"Host: localhost\r\nHost: evil.example\r\n"):
        answer = raw(server, b"GET / HTTP/1.0\r\n" + hosts + b"\r\n")
        assert answer.split(b"\r\n")[0].split()[1] == b"421"
        assert b"title" not in answer


@pytest.mark.parametrize(
    ("host", "own", "foreign"),
    [
        ("127.0.0.1", ["localhost", "[::1]"], ["192.0.2.7", "robot.lan"]),
        ("robot.lan", ["robot.lan:7000", "Robot.LAN", "localhost"], ["192.0.2.7", "evil.example"]),
        ("0.0.0.0", ["192.0.2.7:7000", "[2001:db8::7]", "0.0.0.0", socket.gethostname()], ["evil.example", "192.0.2.7.evil.example"]),
        ("::", ["192.0.2.7:7000", "[2001:db8::7]:7000", "localhost"], ["evil.example"]),
    ],
)
def test_who_may_ask_follows_from_the_address(host: str, own: list[str], foreign: list[str]) -> None:
    """Loopback and the stated host; on every interface any address, too, but no name of others."""
    assert [name for name in own if not is_own_name([name], host)] == []
    assert [name for name in foreign if is_own_name([name], host)] == []


@pytest.mark.parametrize("host", ["", " ", "\t"])
def test_no_address_is_not_every_interface(host: str) -> None:
    """An empty --host, as of a variable that is not set, is refused."""
    with pytest.raises(UsageError, match=r"--host: expected an address, found nothing; 0\.0\.0\.0 lets"):
        PageServer(PAGE, host, 0)


def test_a_host_that_cannot_be_a_name_is_refused() -> None:
    """In one line."""
    with pytest.raises(UsageError, match="cannot listen on"):
        PageServer(PAGE, "x" * 80 + ".example", 0)


def test_loopback_of_ipv6_is_served() -> None:
    """`--host ::1`, where this machine has it."""
    try:
        socket.create_server(("::1", 0), family=socket.AF_INET6).close()
    except OSError:
        pytest.skip("no IPv6 here")
    with PageServer(PAGE, "::1", 0) as server:
        assert server.url == f"http://[::1]:{server.port}/"
        connection = http.client.HTTPConnection("::1", server.port, timeout=10)
        connection.request("GET", "/")
        assert connection.getresponse().read() == PAGE


def test_a_tab_that_is_closed_prints_nothing(server: PageServer, capfd: pytest.CaptureFixture[str]) -> None:
    """Neither before the answer nor in the midst of it; the next one is answered."""
    for request in (b"", b"GE", b"GET / HTTP/1.1\r\nHost: localhost\r\n\r\n"):
        for _ in range(3):
            connection = socket.create_connection(("127.0.0.1", server.port), timeout=10)
            connection.sendall(request)
            connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))  # closed at once, with a reset
            time.sleep(0.05)
            connection.close()
    time.sleep(0.3)
    assert asked(server)[0].status == 200
    assert capfd.readouterr() == ("", "")


def test_answers_are_for_this_page_alone(server: PageServer) -> None:
    """No other page may load them as a script or a picture, and nothing is guessed from their content."""
    answer, _ = asked(server)
    assert answer.getheader("Cross-Origin-Resource-Policy") == "same-origin"
    assert answer.getheader("X-Content-Type-Options") == "nosniff"
