"""A headless Chromium that is driven by the DevTools protocol over a loopback websocket."""

from __future__ import annotations

import asyncio
import base64
import json
import shutil
import subprocess
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from tornado.httpclient import AsyncHTTPClient
from tornado.websocket import WebSocketClientConnection, websocket_connect

NAMES = ("chromium", "chromium-browser", "google-chrome", "chrome")
FLAGS = (
    "--headless",
    "--hide-scrollbars",
    "--no-sandbox",
    "--disable-gpu",
    "--no-first-run",
    "--disable-extensions",
)
LONGEST = 300.0
"""Seconds that the browser may take for anything, on a machine that others keep busy."""


def browser() -> str:
    """The path of a Chromium; raises where there is none."""
    found = next((path for name in NAMES if (path := shutil.which(name))), None)
    if found is None:
        raise RuntimeError("there is no Chromium: on Debian, apt install chromium")
    return found


class Page:
    """One tab: what it says on its console is kept in `console`."""

    def __init__(self, loop: asyncio.AbstractEventLoop, socket: WebSocketClientConnection) -> None:
        self.loop, self.socket = loop, socket
        self.console: list[str] = []
        self.requests: list[str] = []
        self._count = 0
        for domain in ("Runtime", "Page", "Log", "Network"):
            self.send(f"{domain}.enable")

    def send(self, method: str, **parameters: Any) -> dict[str, Any]:
        """A command of the protocol, and what it answers."""
        return self.loop.run_until_complete(
            asyncio.wait_for(self._send(method, parameters), LONGEST)
        )

    async def _send(self, method: str, parameters: dict[str, Any]) -> dict[str, Any]:
        self._count += 1
        mine = self._count
        message = {"id": mine, "method": method, "params": parameters}
        await self.socket.write_message(json.dumps(message))
        while True:
            text = await self.socket.read_message()
            if text is None:
                raise RuntimeError("the browser has gone")
            answer = json.loads(text)
            if answer.get("id") == mine:
                if "error" in answer:
                    raise RuntimeError(f"{method}: {answer['error']}")
                return dict(answer["result"])
            if "method" in answer:  # else it is late, and nobody waits for it any more
                self._heard(answer)

    def _heard(self, event: dict[str, Any]) -> None:
        what = event.get("params", {})
        if event["method"] == "Runtime.exceptionThrown":
            details = what["exceptionDetails"]
            said = details.get("exception", {}).get("description", "")
            self.console.append(f"{details['text']} {said}")
        if event["method"] == "Runtime.consoleAPICalled" and what["type"] in ("error", "warning"):
            self.console.append(" ".join(str(one.get("value", one)) for one in what["args"]))
        if event["method"] == "Log.entryAdded" and what["entry"]["level"] == "error":
            self.console.append(what["entry"]["text"])
        if event["method"] == "Network.requestWillBeSent":
            self.requests.append(what["request"]["url"])

    def ask(self, expression: str) -> Any:
        """The value of a JavaScript expression; of a promise what it brings."""
        found = self.send(
            "Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True
        )
        if "exceptionDetails" in found:
            raise RuntimeError(f"{expression}: {found['exceptionDetails']}")
        return found["result"].get("value")

    def open(self, path: Path, width: int = 1300, scheme: str = "light") -> None:
        """Open a file and wait until its charts are drawn."""
        self.console.clear()
        self.requests.clear()
        self.size(width, 900)
        self.send("Emulation.setEmulatedMedia",
                  features=[{"name": "prefers-color-scheme", "value": scheme}])  # fmt: skip
        self.send("Page.navigate", url=path.resolve().as_uri())
        self.wait("document.documentElement?.dataset.ready === 'yes'")

    def wait(self, condition: str) -> None:
        """Until a JavaScript expression is true."""
        self.ask(
            "new Promise((good, bad) => { const since = Date.now(); const look = () => {"
            f" if ({condition}) good(true);"
            f" else if (Date.now() - since > {500 * LONGEST:.0f}) bad(new Error('waited in vain'));"
            " else setTimeout(look, 50); }; look(); })"
        )

    def size(self, width: int, height: int) -> None:
        """The size of the window."""
        self.send("Emulation.setDeviceMetricsOverride", width=width, height=height,
                  deviceScaleFactor=1, mobile=False)  # fmt: skip

    def click(self, x: float, y: float) -> None:
        """A click of the mouse."""
        for kind in ("mousePressed", "mouseReleased"):
            self.send("Input.dispatchMouseEvent", type=kind, x=x, y=y, button="left", clickCount=1)

    def press(self, key: str, text: str = "") -> None:
        """A key, with the text that it writes."""
        code = {"Enter": 13, "Escape": 27}[key]
        for kind, written in (("keyDown", text), ("keyUp", "")):
            self.send("Input.dispatchKeyEvent", type=kind, key=key, code=key, text=written,
                      windowsVirtualKeyCode=code)  # fmt: skip

    def move(self, x: float, y: float) -> None:
        """The mouse to a place."""
        self.send("Input.dispatchMouseEvent", type="mouseMoved", x=x, y=y)

    def picture(self, path: Path) -> None:
        """The whole page as a PNG."""
        found = self.send("Page.captureScreenshot", format="png", captureBeyondViewport=True)
        path.write_bytes(base64.b64decode(found["data"]))

    def pdf(self, path: Path) -> None:
        """The page as it is printed."""
        found = self.send("Page.printToPDF", printBackground=True, preferCSSPageSize=True)
        path.write_bytes(base64.b64decode(found["data"]))


@contextmanager
def chromium() -> Iterator[Page]:
    """A browser with a profile of its own, which ends with it."""
    loop = asyncio.new_event_loop()
    with tempfile.TemporaryDirectory(
        prefix="aleator-browser-", ignore_cleanup_errors=True
    ) as profile:
        process = subprocess.Popen(
            [browser(), *FLAGS, f"--user-data-dir={profile}", "--remote-debugging-port=0",
             "about:blank"],
            stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True,
        )  # fmt: skip
        try:
            asyncio.set_event_loop(loop)
            found = Page(loop, loop.run_until_complete(_connected(process)))
            yield found
            found.socket.close()
        finally:
            process.terminate()
            process.wait(timeout=LONGEST)
            if process.stderr is not None:
                process.stderr.close()
            loop.close()


async def _connected(process: subprocess.Popen[str]) -> WebSocketClientConnection:
    assert process.stderr is not None
    for line in process.stderr:
        if "DevTools listening on" in line:
            place = line.split("ws://")[1].split("/")[0]
            break
    else:
        raise RuntimeError("the browser did not start")
    found = await AsyncHTTPClient().fetch(f"http://{place}/json")
    tab = next(one for one in json.loads(found.body) if one["type"] == "page")
    return await websocket_connect(
        tab["webSocketDebuggerUrl"], max_message_size=200 * 2**20, connect_timeout=LONGEST
    )
