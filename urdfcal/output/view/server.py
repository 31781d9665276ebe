"""A server for one page: on loopback unless told otherwise, on the next free port where the wanted one is taken.

It answers to its own names alone: a page elsewhere whose name is made to lead here (DNS rebinding) could read the robot otherwise.
"""

from __future__ import annotations

import ipaddress
import socket
import sys
import threading
from collections.abc import Sequence
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from types import TracebackType
from typing import Any

from urdfcal.base.errors import UsageError

_MOST_TRIES = 50  # ports
_LOOPBACK = ("localhost", "127.0.0.1", "::1")
_PATIENCE = 30.0  # [s] for a request to be whole


class PageServer:
    """Serves one page in a thread of its own until it is closed.

    Attributes:
        url: Where to find the page.
        port: The port that was free.
    """

    def __init__(self, page: bytes, host: str = "127.0.0.1", port: int = 7000) -> None:
        """Listen on `port`, or the next free one; 0 takes any.

        Raises:
            UsageError: no port is free, or the address is not this machine's, or none.
        """
        self._server = _listen(page, host, port)
        self.port = int(self._server.server_address[1])
        name = f"[{host}]" if ":" in host else host
        self.url = f"http://{name}:{self.port}/"
        self._thread = threading.Thread(target=self._server.serve_forever, kwargs={"poll_interval": 0.1}, daemon=True)
        self._thread.start()

    def wait(self) -> None:
        """Stay until the server is closed; Ctrl-C comes through as KeyboardInterrupt."""
        while self._thread.is_alive():
            self._thread.join(0.5)

    def close(self) -> None:
        """Stop listening."""
        self._server.shutdown()
        self._server.server_close()
        self._thread.join()

    def __enter__(self) -> PageServer:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.close()


def require_address(host: str, port: int) -> None:
    """Refuse what can be no address to listen on.

    Raises:
        UsageError: the port is out of range, or the host is empty, which would mean every interface.
    """
    if not 0 <= port <= 65535:
        raise UsageError(f"--port {port}: expected a number from 0 to 65535")
    if not host.strip():
        raise UsageError("--host: expected an address, found nothing; 0.0.0.0 lets every machine in the network look")


def _listen(page: bytes, host: str, port: int) -> ThreadingHTTPServer:
    require_address(host, port)
    trouble = ""
    for wanted in range(port, min(port + _MOST_TRIES, 65536)):
        try:
            return _server_class(host)((host, wanted), _handler(page, host))
        except (OSError, UnicodeError) as error:  # UnicodeError: a host that can be no name
            trouble = getattr(error, "strerror", None) or str(error)
            if isinstance(error, PermissionError):
                continue
    raise UsageError(f"cannot listen on {host}, ports {port} to {min(port + _MOST_TRIES, 65536) - 1}: {trouble}")


class _Server(ThreadingHTTPServer):
    allow_reuse_address = False  # else a port that another server holds would be taken for free on some systems
    daemon_threads = True

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Say nothing of a tab that was closed while it was loading."""
        if not isinstance(sys.exception(), OSError):
            super().handle_error(request, client_address)


class _ServerOfSix(_Server):
    address_family = socket.AF_INET6


def _server_class(host: str) -> type[_Server]:
    return _ServerOfSix if ":" in host else _Server


def _handler(page: bytes, host: str) -> type[BaseHTTPRequestHandler]:
    class Handler(BaseHTTPRequestHandler):
        timeout = _PATIENCE
        server_version, sys_version = "urdfcal", ""

        def do_GET(self) -> None:
            self.wfile.write(self._answer())

        def do_HEAD(self) -> None:
            self._answer()

        def _answer(self) -> bytes:
            """Send what stands before the content, and give that back."""
            status, kind, content = 404, "plain", b"there is only /"
            if not is_own_name(self.headers.get_all("Host", []), host):
                status, content = 421, b"this server does not go by that name"
            elif self.path.split("?")[0] in ("/", "/index.html"):
                status, kind, content = 200, "html", page
            self.send_response(status)
            self.send_header("Content-Type", f"text/{kind}; charset=utf-8")
            self.send_header("Content-Length", str(len(content)))
            self.send_header("Cache-Control", "no-store")
            self.send_header("Cross-Origin-Resource-Policy", "same-origin")
            self.send_header("X-Content-Type-Options", "nosniff")
            self.end_headers()
            return content

        def log_message(self, format: str, *args: Any) -> None:
            """Say nothing of every request."""

    return Handler


def is_own_name(headers: Sequence[str], host: str) -> bool:
    """Whether a request is meant for this server: its one Host header names loopback or the address that was asked for, at any port.

    On every interface it goes by this machine's name and by any address, since an address cannot be made to lead elsewhere.

    Args:
        headers: Every Host header of the request.
        host: The address that the server was told to listen on.
    """
    name = _without_port(headers[0].strip()) if len(headers) == 1 else ""
    own = {*_LOOPBACK, host.strip().lower()}
    if _address(host) in (ipaddress.IPv4Address(0), ipaddress.IPv6Address(0)):
        return name in own | {socket.gethostname().lower(), socket.getfqdn().lower()} or _address(name) is not None
    return name in own


def _without_port(header: str) -> str:
    """The name in `name`, `name:port`, `[address]` or `[address]:port`."""
    if header.startswith("["):
        return header[1:].partition("]")[0].lower()
    return header.partition(":")[0].lower().removesuffix(".")


def _address(name: str) -> ipaddress.IPv4Address | ipaddress.IPv6Address | None:
    try:
        return ipaddress.ip_address(name.strip())
    except ValueError:
        return None
