"""A headless Chromium that tests talk to over its DevTools pipe: open a page, look at it, use it, hear what went wrong."""

from __future__ import annotations

import base64
import contextlib
import io
import json
import os
import select
import shutil
import subprocess
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
needs_browser = pytest.mark.skipif(CHROMIUM is None, reason="no chromium on this machine: pages were not opened")
FLAGS = (
    *("--headless", "--no-sandbox", "--enable-unsafe-swiftshader", "--use-angle=swiftshader", "--hide-scrollbars"),
    *("--disable-dev-shm-usage", "--no-first-run", "--disable-background-networking", "--remote-debugging-pipe"),
)
CURVES = "!!document.querySelector('.legend [aria-pressed]')"
PATIENCE = 60.0  # [s] for anything; pages are drawn in software here, on a machine that may be busy


class Browser:
    """One browser; a page at a time."""

    def __init__(self, folder: Path) -> None:
        assert CHROMIUM is not None
        theirs_in, self.to = os.pipe()
        self.back, theirs_out = os.pipe()
        shell = f'exec "$0" "$@" 3<&{theirs_in} 4>&{theirs_out}'  # it reads from 3 and writes to 4
        words = ["bash", "-c", shell, CHROMIUM, *FLAGS, f"--user-data-dir={folder / 'profile'}"]
        quiet: dict[str, Any] = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
        self.process = subprocess.Popen(words, pass_fds=(theirs_in, theirs_out), **quiet)
        for fd in (theirs_in, theirs_out):
            os.close(fd)
        self.unread, self.count, self.session = b"", 0, ""
        self.events: list[dict[str, Any]] = []

    def close(self) -> None:
        """Ends it."""
        with contextlib.suppress(OSError):
            self.call("Browser.close")
        try:
            self.process.wait(20)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
        os.close(self.to)
        os.close(self.back)

    def call(self, method: str, **parameters: Any) -> dict[str, Any]:
        """Asks for something and waits for the answer; events on the way are kept."""
        self.count += 1
        message = {"id": self.count, "method": method, "params": parameters}
        if self.session and not method.startswith(("Target.", "Browser.")):
            message["sessionId"] = self.session
        os.write(self.to, json.dumps(message).encode() + b"\0")
        end = time.monotonic() + PATIENCE
        while True:
            while b"\0" not in self.unread:
                ready, _, _ = select.select([self.back], [], [], max(end - time.monotonic(), 0))
                piece = os.read(self.back, 1 << 20) if ready else b""
                if not piece:
                    raise OSError(f"{method}: the browser does not answer")
                self.unread += piece
            text, _, self.unread = self.unread.partition(b"\0")
            answer = json.loads(text)
            if answer.get("id") == self.count:
                assert "error" not in answer, f"{method}: {answer['error']}"
                return answer["result"]
            self.events.append(answer)

    def open(
        self, page: Path | str, fragment: str = "", size: tuple[int, int] = (900, 900), stands: str = CURVES
    ) -> None:
        """Opens a page, from a file or by its address, and waits until its curves stand, or another expression is true."""
        if self.session:
            self.call("Target.closeTarget", targetId=self.target)
        self.target = self.call("Target.createTarget", url="about:blank")["targetId"]
        self.session = self.call("Target.attachToTarget", targetId=self.target, flatten=True)["sessionId"]
        self.events.clear()
        for domain in ("Page", "Runtime", "Network", "Log"):
            self.call(f"{domain}.enable")
        metrics = {"width": size[0], "height": size[1], "deviceScaleFactor": 1, "mobile": False}
        self.call("Emulation.setDeviceMetricsOverride", **metrics)
        self.url = page if isinstance(page, str) else page.resolve().as_uri()
        self.call("Page.navigate", url=self.url + fragment)
        end = time.monotonic() + PATIENCE
        while not self.value(f"document.readyState == 'complete' && ({stands})"):
            assert time.monotonic() < end, f"the page does not stand: {self.faults()}"
            time.sleep(0.05)
        self.settle()

    def settle(self) -> None:
        """Waits until what was asked for is drawn."""
        frames = "new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(() => requestAnimationFrame(done))))"
        self.value(f"{frames}.then(() => 0)")

    def value(self, expression: str) -> Any:
        """Value of an expression in the page; promises are awaited."""
        asked = {"expression": expression, "awaitPromise": True, "returnByValue": True}
        answer = self.call("Runtime.evaluate", **asked)
        assert "exceptionDetails" not in answer, answer
        return answer["result"].get("value")

    def text(self, selector: str) -> str:
        """Visible text of an element."""
        return self.value(f"document.querySelector({json.dumps(selector)}).innerText")

    def mouse(self, selector: str, across: float, down: float, *kinds: str, **more: Any) -> None:
        """The mouse at (across, down) [px] in an element: mouseMoved, mousePressed, mouseReleased, mouseWheel."""
        box = f"document.querySelector({json.dumps(selector)}).getBoundingClientRect()"
        left, top = self.value(f"(() => {{ const box = {box}; return [box.left, box.top]; }})()")
        for kind in kinds:
            button = {"button": "left", "clickCount": 1} if kind in ("mousePressed", "mouseReleased") else {}
            held = {"button": "left", "buttons": 1} if kind == "mouseDragged" else {}
            name = "mouseMoved" if kind == "mouseDragged" else kind
            event = {"x": left + across, "y": top + down, **button, **held, **more}
            self.call("Input.dispatchMouseEvent", type=name, **event)
        self.settle()

    def picture(self) -> np.ndarray:
        """(height, width, 3) what a reader sees, 0 to 255."""
        from PIL import Image

        data = self.call("Page.captureScreenshot", format="png")["data"]
        return np.asarray(Image.open(io.BytesIO(base64.b64decode(data))).convert("RGB")).astype(int)

    def faults(self) -> list[str]:
        """Exceptions, errors of the console, and everything that was asked of other addresses than the page's."""
        found = []
        for event in self.events:
            method, about = event.get("method", ""), event.get("params", {})
            if method == "Runtime.exceptionThrown":
                found.append(about["exceptionDetails"].get("exception", {}).get("description", "an exception"))
            elif method == "Log.entryAdded" and about["entry"]["level"] == "error":
                found.append(about["entry"]["text"])
            elif method == "Network.requestWillBeSent" and not about["request"]["url"].startswith(
                ("file:", "blob:", "data:", self.url)
            ):
                found.append(about["request"]["url"])
        return found
