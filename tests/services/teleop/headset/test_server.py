"""The web server, over real sockets: who gets in, what is refused, and that nobody slows others."""

import asyncio
import json
import ssl
import time
from collections.abc import AsyncIterator, Awaitable, Callable, Iterator
from contextlib import asynccontextmanager, closing
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("aiohttp")
pytest.importorskip("cryptography")
pytest.importorskip("segno")

import aiohttp
from aiohttp import WSCloseCode, WSMsgType

from services.teleop.errors import TeleopError
from services.teleop.headset.config import HeadsetConfig
from services.teleop.headset.credentials import prepare
from services.teleop.headset.hub import Hub, Picture
from services.teleop.headset.protocol import LARGEST_MESSAGE, Alive
from services.teleop.headset.serve import link
from services.teleop.headset.server import PATIENCE, RATE, WINDOW, WebServer

PATIENCE_S = 20.0


class Site:
    """A running server and what a browser knows of it."""

    def __init__(self, folder: Path, **config: Any) -> None:
        self.config = HeadsetConfig(port=0, folder=folder, **config)
        self.credentials = prepare(self.config)
        self.hub = Hub()
        self.server = WebServer(self.config, self.credentials, self.hub)
        self.server.start()
        self.url = link(self.credentials, self.server.port).partition("#")[0]

    @property
    def origin(self) -> str:
        return self.url.rstrip("/")

    def close(self) -> None:
        self.server.close()

    @asynccontextmanager
    async def page(
        self, token: str | None = None, origin: str | None = None, **options: Any
    ) -> AsyncIterator[Any]:
        token = self.credentials.token if token is None else token
        headers = {"Origin": self.origin if origin is None else origin}
        async with (
            aiohttp.ClientSession() as session,
            session.ws_connect(
                f"{self.url}socket", params={"token": token}, headers=headers, **options
            ) as socket,
        ):
            yield socket

    async def until(self, true: Callable[[], bool]) -> None:
        deadline = time.monotonic() + PATIENCE_S
        while not true():
            assert time.monotonic() < deadline
            await asyncio.sleep(0.01)


@pytest.fixture
def site(tmp_path: Path) -> Iterator[Site]:
    with closing(Site(tmp_path)) as running:
        yield running


def run(work: Awaitable[None]) -> None:
    async def limited() -> None:
        async with asyncio.timeout(PATIENCE_S):
            await work

    asyncio.run(limited())


def picture(number: int) -> Picture:
    return Picture(number, 10 * number, 0.1, 0.02, time.monotonic_ns(), b"l" * 9000, b"r" * 9000)


def number_of(data: bytes) -> int:
    length = int.from_bytes(data[:4], "little")
    return int(json.loads(data[4 : 4 + length])["number"])


@pytest.mark.parametrize("token", ["", "wrong", "é" * 12])
def test_a_wrong_token_is_refused_and_counted(site: Site, token: str) -> None:
    async def knock() -> None:
        with pytest.raises(aiohttp.WSServerHandshakeError, match="401"):
            async with site.page(token=token):
                pass

    run(knock())
    assert site.hub.refusals.token == 1


@pytest.mark.parametrize(
    "origin", ["", "null", "https://evil.example", "http://127.0.0.1:1", "http://[", "file://"]
)
def test_pages_of_other_sites_are_refused_though_they_know_the_token(
    site: Site, origin: str
) -> None:
    async def knock() -> None:
        with pytest.raises(aiohttp.WSServerHandshakeError, match="403"):
            async with site.page(origin=origin):
                pass

    run(knock())
    assert site.hub.refusals.origin == 1


def test_localhost_is_the_same_site(site: Site) -> None:
    async def enter() -> None:
        async with site.page(origin=f"http://localhost:{site.server.port}") as socket:
            assert not socket.closed

    run(enter())


def test_what_a_page_sends_reaches_the_operator_and_garbage_is_counted(site: Site) -> None:
    async def talk() -> None:
        async with site.page() as socket:
            await socket.send_str("garbage")
            await socket.send_bytes(b"\x00\x01")
            await socket.send_str('{"type":"alive","t":5}')
            await site.until(lambda: site.hub.refusals.garbage == 2)
            await asyncio.sleep(0.05)

    run(talk())
    time.sleep(0.1)
    events = site.hub.drain()
    assert [event.message for event in events] == [Alive(type="alive", t=5.0), None]
    assert len({event.page for event in events}) == 1


@pytest.mark.parametrize(
    ("text", "code", "kind"),
    [
        ("x" * (LARGEST_MESSAGE + 1), WSCloseCode.MESSAGE_TOO_BIG, "oversized"),
        ("garbage", WSCloseCode.POLICY_VIOLATION, "garbage"),
    ],
)
def test_who_sends_too_much_or_only_garbage_is_sent_away(
    site: Site, text: str, code: WSCloseCode, kind: str
) -> None:
    async def misbehave() -> None:
        async with site.page() as socket:
            for _ in range(1 if kind == "oversized" else PATIENCE + 1):
                await socket.send_str(text)
            message = await socket.receive()
            assert message.type in {WSMsgType.CLOSE, WSMsgType.CLOSED}
            assert socket.close_code == code
        await site.until(lambda: getattr(site.hub.refusals, kind) > 0)

    run(misbehave())


def test_a_flood_is_cut_and_counted(site: Site) -> None:
    async def flood() -> None:
        async with site.page() as socket:
            for _ in range(int(RATE) + 200):
                await socket.send_str('{"type":"alive","t":5}')
            await site.until(lambda: site.hub.refusals.flood > PATIENCE)

    run(flood())
    assert len(site.hub.drain()) <= RATE + 200


def test_ten_pages_see_every_picture_and_a_slow_one_slows_nobody(site: Site) -> None:
    shown = 20

    async def watch(seen: list[int], *, answers: bool) -> None:
        async with site.page() as socket:
            async for message in socket:
                if message.type is not WSMsgType.BINARY:
                    continue
                seen.append(number_of(message.data))
                if answers:
                    text = {"type": "shown", "t": 1.0, "picture": seen[-1]}
                    await socket.send_str(json.dumps(text))

    async def exhibit() -> None:
        seen: list[list[int]] = [[] for _ in range(10)]
        slow: list[int] = []
        tasks = [asyncio.ensure_future(watch(one, answers=True)) for one in seen]
        tasks.append(asyncio.ensure_future(watch(slow, answers=False)))
        await site.until(lambda: len(site.server._connections) == 11)
        for number in range(1, shown + 1):
            site.hub.show_picture(picture(number))
            while any(one[-1:] != [number] for one in seen):
                await asyncio.sleep(0.01)
        assert all(one == list(range(1, shown + 1)) for one in seen)
        assert slow == list(range(1, WINDOW + 1))
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)

    run(exhibit())


def test_a_page_gets_the_newest_picture_and_status_only(site: Site) -> None:
    async def late() -> None:
        for number in range(1, 9):
            site.hub.show_picture(picture(number))
            site.hub.show({"count": number}, {1: {"drives": True}})
        async with site.page() as socket:
            first, second = await socket.receive(), await socket.receive()
            assert json.loads(first.data) == {"count": 8, "you": {"drives": True}}
            assert number_of(second.data) == 8

    run(late())


def test_there_is_a_largest_number_of_pages(tmp_path: Path) -> None:
    async def crowd(site: Site) -> None:
        async with site.page(), site.page():
            with pytest.raises(aiohttp.WSServerHandshakeError, match="503"):
                async with site.page():
                    pass
        async with site.page() as socket:
            assert not socket.closed

    with closing(Site(tmp_path, pages=2)) as site:
        run(crowd(site))
        assert site.hub.refusals.pages == 1


def test_the_files_are_those_of_the_page_and_load_nothing_from_elsewhere(site: Site) -> None:
    async def browse() -> None:
        async with aiohttp.ClientSession() as session:
            for name, kind in (("", "html"), ("main.js", "javascript")):
                async with session.get(site.url + name) as answer:
                    assert answer.status == 200
                    assert kind in answer.content_type
                    policy = answer.headers["Content-Security-Policy"]
                    assert "default-src 'none'" in policy
                    assert "http" not in policy
            for path in ("..%2fserver.py", "page/../..%2fserver.py", "none"):
                async with session.get(site.url + path) as answer:
                    assert answer.status in {403, 404}, path
            refused = {"token": "wrong"}
            headers = {"Origin": site.origin}
            async with session.post(f"{site.url}socket", params=refused, headers=headers) as answer:
                assert answer.status == 401
                assert "wrong token" in await answer.text()

    run(browse())


def test_in_the_network_it_is_served_over_tls_with_a_certificate_for_its_names(
    tmp_path: Path,
) -> None:
    async def enter(site: Site) -> None:
        context = ssl.create_default_context(cafile=str(tmp_path / "certificate.pem"))
        async with site.page(ssl=context) as socket:
            await socket.send_str('{"type":"alive","t":5}')

    with closing(Site(tmp_path, address="0.0.0.0")) as site:
        assert site.url.startswith("https://")
        site.url = f"https://localhost:{site.server.port}/"
        run(enter(site))
        assert not site.hub.refusals.origin


def test_a_port_that_is_taken_is_an_error_in_words(site: Site) -> None:
    config = site.config.model_copy(update={"port": site.server.port})
    second = WebServer(config, replace(site.credentials), Hub())
    with pytest.raises(TeleopError, match=r"choose another one: --port"):
        second.start()


def test_the_server_ends_though_pages_do_not_answer(tmp_path: Path) -> None:
    async def linger(site: Site) -> None:
        async with site.page(), site.page(), site.page():
            # These clients read nothing, and so do not answer the goodbye.
            await asyncio.to_thread(site.close)

    site = Site(tmp_path)
    run(linger(site))
    assert not site.server._thread.is_alive()
