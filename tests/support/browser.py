"""A headless Chromium, driven over the pipe of the Chrome DevTools Protocol; needs nothing but the browser itself."""

from __future__ import annotations

import base64
import fcntl
import json
import os
import select
import shutil
import subprocess
import tempfile
import time
from pathlib import Path
from types import TracebackType
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

Picture = npt.NDArray[np.uint8]
FLAGS = (
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--hide-scrollbars",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-dev-shm-usage",
    "--mute-audio",
    "--remote-debugging-pipe",
)
NAMES = ("chromium", "chromium-browser", "google-chrome", "chrome")


def find_browser() -> str | None:
    """Where a Chromium is; $URDFCAL_BROWSER goes first."""
    return next((found for name in (os.environ.get("URDFCAL_BROWSER", ""), *NAMES) if name and (found := shutil.which(name))), None)


class Browser:
    """One page of a headless Chromium."""

    def __init__(self, width: int = 1200, height: int = 800, patience: float = 120.0) -> None:
        self.patience, self.console = patience, []
        self._folder = tempfile.TemporaryDirectory(prefix="urdfcal-browser-")
        theirs_in, self._to = os.pipe()
        self._from, theirs_out = os.pipe()
        reading, writing = (fcntl.fcntl(end, fcntl.F_DUPFD, 20) for end in (theirs_in, theirs_out))  # out of the way of 3 and 4
        shell = f'exec "$@" 3<&{reading} 4>&{writing}'
        words = [
            "bash",
            "-c",
            shell,
            "bash",
            str(find_browser()),
            *FLAGS,
            f"--window-size={width},{height}",
            f"--user-data-dir={self._folder.name}",
        ]
        self._process = subprocess.Popen(
            [*words, "about:blank"], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, pass_fds=(reading, writing)
        )
        for end in (theirs_in, theirs_out, reading, writing):
            os.close(end)
        self._pending, self._number, self._session = b"", 0, None
        targets = self.call("Target.getTargets")["targetInfos"]
        page = next(target["targetId"] for target in targets if target["type"] == "page")
        self._session = self.call("Target.attachToTarget", targetId=page, flatten=True)["sessionId"]
        for domain in ("Page", "Runtime", "Log"):
            self.call(f"{domain}.enable")
        self.resize(width, height)

    def call(self, method: str, **parameters: Any) -> dict[str, Any]:
        """Send one command and wait for its answer."""
        self._number += 1
        message = {"id": self._number, "method": method, "params": parameters}
        if self._session:
            message["sessionId"] = self._session
        os.write(self._to, json.dumps(message).encode() + b"\0")
        while True:
            answer = self._read()
            if answer.get("id") == self._number:
                if "error" in answer:
                    raise RuntimeError(f"{method}: {answer['error']}")
                return dict(answer["result"])
            self._note(answer)

    def open(self, url: str | Path, ready: str = "document.documentElement?.dataset.ready") -> float:
        """Load a page and wait until it is ready (a scene: until it is drawn); gives back the milliseconds `ready` states, in s."""
        self.console.clear()
        self.call("Page.navigate", url=url if isinstance(url, str) else url.resolve().as_uri())
        return float(self.wait_for(ready)) / 1e3

    def wait_for(self, expression: str) -> Any:
        """The value of an expression of JavaScript as soon as it is true."""
        end = time.monotonic() + self.patience
        while time.monotonic() < end:
            if found := self.run(expression):
                return found
            time.sleep(0.05)
        raise TimeoutError(f"{expression} stayed false for {self.patience} s; console: {self.console}")

    def run(self, expression: str) -> Any:
        """The value of an expression of JavaScript."""
        result = self.call("Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True)
        if "exceptionDetails" in result:
            raise RuntimeError(result["exceptionDetails"].get("exception", {}).get("description", str(result["exceptionDetails"])))
        return result["result"].get("value")

    def resize(self, width: int, height: int, scale: float = 1.0) -> None:
        """Give the page this size in CSS pixels, `scale` picture pixels each."""
        self.call("Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=scale, mobile=False)

    def picture(self, path: Path | None = None) -> Picture:
        """What is to be seen, (height, width, 3), red first; also as a file, if named."""
        self.run("new Promise(done => requestAnimationFrame(() => requestAnimationFrame(() => done(1))))")
        data = base64.b64decode(self.call("Page.captureScreenshot", format="png")["data"])
        if path is not None:
            path.write_bytes(data)
        picture = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)
        return np.ascontiguousarray(picture[:, :, ::-1])

    def close(self) -> None:
        """End the browser."""
        try:
            self._session = None
            self.call("Browser.close")
            self._process.wait(10)
        except (OSError, TimeoutError, EOFError, subprocess.TimeoutExpired):
            self._process.kill()
            self._process.wait()
        for end in (self._to, self._from):
            os.close(end)
        self._folder.cleanup()

    def __enter__(self) -> Browser:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.close()

    def _read(self) -> dict[str, Any]:
        end = time.monotonic() + self.patience
        while b"\0" not in self._pending:
            if not select.select([self._from], [], [], max(0.0, end - time.monotonic()))[0]:
                raise TimeoutError(f"the browser did not answer within {self.patience} s")
            chunk = os.read(self._from, 1 << 20)
            if not chunk:
                raise EOFError("the browser is gone")
            self._pending += chunk
        message, self._pending = self._pending.split(b"\0", 1)
        return dict(json.loads(message))

    def _note(self, event: dict[str, Any]) -> None:
        """Keep what the console says, errors and warnings alike."""
        what = event.get("params", {})
        if event.get("method") == "Runtime.consoleAPICalled":
            words = " ".join(str(argument.get("value", argument.get("description"))) for argument in what["args"])
            self.console.append(f"{what['type']}: {words}")
        elif event.get("method") == "Runtime.exceptionThrown":
            self.console.append(f"exception: {what['exceptionDetails'].get('exception', {}).get('description', what['exceptionDetails'])}")
        elif event.get("method") == "Log.entryAdded":
            self.console.append(f"{what['entry']['level']}: {what['entry']['text']}")
