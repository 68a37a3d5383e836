"""A tab of a headless Chromium, driven over the DevTools protocol."""

import asyncio
import base64
import contextlib
import os
import shutil
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import aiohttp

from common.errors import TrillError

NAMES = ("chromium", "chromium-browser", "google-chrome", "chrome")
FLAGS = (
    *("--headless", "--remote-debugging-port=0", "--remote-allow-origins=*", "--no-first-run"),
    *("--disable-background-networking", "--disable-component-update", "--disable-sync"),
    # Drawing without a graphics card.
    *("--disable-gpu", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"),
)
START_TIMEOUT = 30.0
ANSWER_TIMEOUT = 30.0


class BrowserError(TrillError):
    """There is no browser, or it does not do what it is asked for."""


class Tab:
    """One tab.

    Attributes:
        errors: what the page complained of: exceptions, violations of its policy.
        requests: addresses that the page asked for.
    """

    def __init__(self, socket: aiohttp.ClientWebSocketResponse) -> None:
        self.errors: list[str] = []
        self.requests: list[str] = []
        self._socket = socket
        self._number = 0
        self._answers: dict[int, asyncio.Future[dict[str, Any]]] = {}

    async def listen(self) -> None:
        """Take in what the browser says, until it closes."""
        async for message in self._socket:
            told = message.json()
            if "id" in told:
                self._answers.pop(told["id"]).set_result(told)
            elif told["method"] == "Runtime.exceptionThrown":
                details = told["params"]["exceptionDetails"]
                self.errors.append(details.get("exception", {}).get("description", str(details)))
            elif told["method"] == "Log.entryAdded" and told["params"]["entry"]["level"] == "error":
                self.errors.append(told["params"]["entry"]["text"])
            elif told["method"] == "Network.requestWillBeSent":
                self.requests.append(told["params"]["request"]["url"])

    async def call(self, method: str, **params: Any) -> dict[str, Any]:
        """Call a method of the protocol.

        Raises:
            BrowserError: it is refused, or not answered.
        """
        self._number += 1
        number = self._number
        answer = self._answers[number] = asyncio.get_running_loop().create_future()
        await self._socket.send_json({"id": number, "method": method, "params": params})
        try:
            told = await asyncio.wait_for(answer, ANSWER_TIMEOUT)
        except TimeoutError as error:
            raise BrowserError(f"no answer to {method} within {ANSWER_TIMEOUT:g} s") from error
        if "error" in told:
            raise BrowserError(f"{method} was refused: {told['error']['message']}")
        result: dict[str, Any] = told["result"]
        return result

    async def evaluate(self, script: str) -> Any:
        """Return the value of a script, after a click of the person as far as the page knows.

        Raises:
            BrowserError: it throws.
        """
        result = await self.call(
            "Runtime.evaluate",
            expression=script,
            awaitPromise=True,
            returnByValue=True,
            userGesture=True,
        )
        if "exceptionDetails" in result:
            raise BrowserError(f"{script!r} throws: {result['exceptionDetails']}")
        return result["result"].get("value")

    async def press(self, key: str) -> None:
        """Press and release a key."""
        named = {"Enter": {"text": "\r"}, "Tab": {}}
        more = named.get(key, {"text": key})
        await self.call("Input.dispatchKeyEvent", type="keyDown", key=key, **more)
        await self.call("Input.dispatchKeyEvent", type="keyUp", key=key)

    async def mouse(self, kind: str, x: float, y: float) -> None:
        """Press, move or release the left button; ``kind`` is ``mousePressed`` or the like."""
        await self.call(
            "Input.dispatchMouseEvent", type=kind, x=x, y=y, button="left", buttons=1, clickCount=1
        )

    async def screenshot(self, path: Path) -> None:
        """Save what is shown as a PNG file."""
        told = await self.call("Page.captureScreenshot", format="png")
        path.write_bytes(base64.b64decode(told["data"]))


@asynccontextmanager
async def browser(profile: Path, width: int, height: int, script: str = "") -> AsyncIterator[Tab]:
    """Start a browser with an empty tab.

    Args:
        profile: folder for the browser's own files.
        width: of the tab [pixels].
        height: likewise.
        script: runs in every page before its own scripts.

    Raises:
        BrowserError: there is no browser, or it does not start.
    """
    found = next(filter(None, map(shutil.which, NAMES)), None)
    if found is None:
        raise BrowserError(f"expected a browser in PATH, one of {', '.join(NAMES)}; install it")
    flags = [*FLAGS, f"--user-data-dir={profile}", f"--window-size={width},{height}"]
    # Its sandbox does not start under root.
    flags += ["--no-sandbox"] * (os.geteuid() == 0)
    nowhere = asyncio.subprocess.DEVNULL
    process = await asyncio.create_subprocess_exec(found, *flags, stdout=nowhere, stderr=nowhere)
    try:
        async with aiohttp.ClientSession() as session:
            address = await _address(session, profile / "DevToolsActivePort")
            async with session.ws_connect(address, max_msg_size=0) as socket:
                tab = Tab(socket)
                listening = asyncio.ensure_future(tab.listen())
                for domain in ("Page", "Runtime", "Log", "Network"):
                    await tab.call(f"{domain}.enable")
                size = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": False}
                await tab.call("Emulation.setDeviceMetricsOverride", **size)
                if script:
                    await tab.call("Page.addScriptToEvaluateOnNewDocument", source=script)
                yield tab
                listening.cancel()
    finally:
        with contextlib.suppress(ProcessLookupError):
            process.terminate()
        await process.wait()


async def _address(session: aiohttp.ClientSession, port_file: Path) -> str:
    """Return the address of a new tab's socket."""
    try:
        async with asyncio.timeout(START_TIMEOUT):
            while not port_file.exists() or not port_file.read_text():
                await asyncio.sleep(0.1)
            port = int(port_file.read_text().split()[0])
            async with session.put(f"http://127.0.0.1:{port}/json/new?about:blank") as answer:
                return str((await answer.json())["webSocketDebuggerUrl"])
    except TimeoutError as error:
        raise BrowserError(f"the browser did not start within {START_TIMEOUT:g} s") from error
