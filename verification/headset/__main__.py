"""``python -m verification.headset``: the operator's page in a real browser, with a real robot."""

import argparse
import asyncio
import os
import socket
import tempfile
from collections.abc import Awaitable, Callable, Sequence
from contextlib import closing
from pathlib import Path
from urllib.parse import urlsplit

from common.program import run_program
from common.tables import validated
from deploy.launch import running_system
from deploy.system import SystemOptions, headset_process
from services.teleop.headset.config import HeadsetConfig
from services.teleop.headset.credentials import prepare
from services.teleop.headset.serve import link
from verification.headset import desktop, worn
from verification.headset.chromium import Tab, browser
from verification.headset.robot import CheckError, Robot, until

Check = Callable[[Tab, Robot, Path], Awaitable[str]]
EMULATED = "&emulated"
"""Option of the page: positions that are only guessed count, as IWER calls all of them."""


def _parse(argv: list[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="python -m verification.headset",
        description="Start the robot and the operator's page, open the page in a headless Chromium "
        "and check it: pictures, keys, a hand that is dragged, a reload in the middle of a gait, "
        "the emergency stop, and that it loads nothing from elsewhere. With --iwer a headset is "
        "emulated in the browser too: engaging, following, the head, haptics. Screenshots stay for "
        "you to look at. Exit code: 1 if a promise is broken.",
    )
    parser.add_argument(
        "--iwer",
        type=Path,
        metavar="FILE",
        help="build/iwer.min.js of the npm package iwer, Meta's emulator of WebXR devices",
    )
    parser.add_argument("--task", help="scored task of the robot (none: flat ground)")
    parser.add_argument("--out", type=Path, default=Path("runs/studies/headset"), help="folder")
    return parser.parse_args(argv)


def main(argv: list[str] | None = None) -> int:
    """Check; exit code 0, 1 if a promise is broken, 2 for a wrong option."""
    arguments = _parse(argv)
    return run_program("headset", lambda: run(arguments), "stopped")


def run(arguments: argparse.Namespace) -> int:
    """Start the robot and check everything; returns 1 if a promise is broken."""
    arguments.out.mkdir(parents=True, exist_ok=True)
    print(f"load average {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores")
    script = arguments.iwer.read_text(encoding="utf-8") if arguments.iwer else ""
    broken = 1
    with tempfile.TemporaryDirectory() as name:
        settings, config = _settings(Path(name))
        url = link(prepare(config), config.port)
        options = SystemOptions(config=settings, record=False, task=arguments.task)
        with (
            running_system(options, None, [headset_process()]) as running,
            closing(Robot(running.bus)) as robot,
        ):
            checks: list[tuple[str, Sequence[Check]]] = [("", desktop.CHECKS)]
            if script:
                checks.append((script + worn.EMULATOR, worn.CHECKS))
            broken = asyncio.run(_all(checks, url, robot, Path(name), arguments.out))
    print(f"screenshots: {arguments.out}")
    return int(broken > 0)


def _settings(folder: Path) -> tuple[Path, HeadsetConfig]:
    """Return a configuration file with a free port and a token of its own, and what it says."""
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    settings = folder / "settings.toml"
    settings.write_text(f'[headset]\nport = {port}\nfolder = "{folder}"\n', encoding="utf-8")
    return settings, validated(HeadsetConfig, {"port": port, "folder": folder})


async def _all(
    groups: Sequence[tuple[str, Sequence[Check]]], url: str, robot: Robot, folder: Path, out: Path
) -> int:
    """Run every group of checks in a browser of its own; return how many failed."""
    await until(lambda: robot.balances, "a robot that balances", patience=60.0)
    broken = 0
    for number, (script, checks) in enumerate(groups):
        profile, size = folder / f"profile-{number}", (800, 400) if script else (1240, 900)
        async with browser(profile, *size, script) as tab:
            await tab.call("Page.navigate", url=url + EMULATED * bool(script))
            await asyncio.sleep(1.0)
            for check in checks:
                broken += await _judge(check, tab, robot, out)
            broken += _own(tab, url)
    return broken


async def _judge(check: Check, tab: Tab, robot: Robot, out: Path) -> bool:
    """Run a check and say how it ended; return whether it failed."""
    what = (check.__doc__ or "").splitlines()[0]
    try:
        told = await check(tab, robot, out)
    except CheckError as error:
        print(f"BROKEN {what} {error}", flush=True)
        return True
    print(f"holds  {what} [{told}]", flush=True)
    return False


def _own(tab: Tab, url: str) -> bool:
    """Say whether the page kept to its own server and complained of nothing."""
    own = urlsplit(url).netloc
    foreign = {where for where in tab.requests if urlsplit(where).netloc not in (own, "") and where}
    if foreign or tab.errors:
        print(f"BROKEN The page loads nothing from elsewhere. {foreign} {tab.errors}")
        return True
    print(f"holds  The page loads nothing from elsewhere. [{len(tab.requests)} requests]")
    return False


if __name__ == "__main__":
    raise SystemExit(main())
