"""A server for one page: on loopback unless told otherwise, on the next free port where the wanted one is taken."""

from __future__ import annotations

import threading
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from types import TracebackType
from typing import Any

from urdfcal.base.errors import UsageError

_MOST_TRIES = 50  # ports


class PageServer:
    """Serves one page in a thread of its own until it is closed.

    Attributes:
        url: Where to find the page.
        port: The port that was free.
    """

    def __init__(self, page: bytes, host: str = "127.0.0.1", port: int = 7000) -> None:
        """Listen on `port`, or the next free one; 0 takes any.

        Raises:
            UsageError: no port is free, or the address is not this machine's.
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


def _listen(page: bytes, host: str, port: int) -> ThreadingHTTPServer:
    if not 0 <= port <= 65535:
        raise UsageError(f"--port {port}: expected a number from 0 to 65535")
    trouble = ""
    for wanted in range(port, min(port + _MOST_TRIES, 65536)):
        try:
            return _Server((host, wanted), _handler(page))
        except OSError as error:
            trouble = error.strerror or str(error)
            if isinstance(error, PermissionError):
                continue
    raise UsageError(f"cannot listen on {host}, ports {port} to {min(port + _MOST_TRIES, 65536) - 1}: {trouble}")


class _Server(ThreadingHTTPServer):
    allow_reuse_address = False  # else a port that another server holds would be taken for free on some systems
    daemon_threads = True


def _handler(page: bytes) -> type[BaseHTTPRequestHandler]:
    class Handler(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            found = self.path.split("?")[0] in ("/", "/index.html")
            content = page if found else b"there is only /"
            self.send_response(200 if found else 404)
            self.send_header("Content-Type", f"text/{'html' if found else 'plain'}; charset=utf-8")
            self.send_header("Content-Length", str(len(content)))
            self.send_header("Cache-Control", "no-store")
            self.end_headers()
            self.wfile.write(content)

        def log_message(self, format: str, *args: Any) -> None:
            """Say nothing of every request."""

    return Handler
