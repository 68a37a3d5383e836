"""Checks of the page on a desktop: pictures, keys, pointer, reload, stop."""

import asyncio
from pathlib import Path

from common.schemas import AuthorityChange, ControlState, GuardMode
from common.topics import PLANT_STATUS, WBC_AUTHORITY, WBC_STATE
from verification.headset.chromium import Tab
from verification.headset.robot import CheckError, Robot, until

BRIGHTNESSES = """(() => {
  const copy = new OffscreenCanvas(40, 30).getContext("2d");
  copy.drawImage(document.querySelector('[data-eye="EYE"] canvas'), 0, 0, 40, 30);
  const pixels = copy.getImageData(0, 0, 40, 30).data;
  return new Set(pixels).size;
})()"""
RING = """(() => {
  const box = document.querySelector('[data-eye="left"] circle.hand.left').getBoundingClientRect();
  return [box.x + box.width / 2, box.y + box.height / 2];
})()"""
WAY = (30.0, -40.0)
"""Of the drag [pixels]."""


async def text(tab: Tab, element: str) -> str:
    """Return the text of an element of the page."""
    return str(await tab.evaluate(f"document.getElementById('{element}').textContent"))


async def pictures(tab: Tab, _robot: Robot, out: Path) -> str:
    """Both eyes show a picture that is no single colour, and its age is told."""
    for eye in ("left", "right"):
        for _ in range(100):
            shades = await tab.evaluate(BRIGHTNESSES.replace("EYE", eye))
            if shades > 20:
                break
            await asyncio.sleep(0.1)
        else:
            raise CheckError(f"expected a picture in the {eye} eye, got {shades} shades")
    await asyncio.sleep(1.0)
    await tab.screenshot(out / "desktop.png")
    return f"link {await text(tab, 'latency')}, picture {await text(tab, 'age')}"


async def take(tab: Tab, robot: Robot, _out: Path) -> str:
    """Enter takes the robot."""
    await tab.press("Enter")
    await until(lambda: _holder(robot) == "headset", "the robot")
    await asyncio.sleep(0.3)
    return await text(tab, "who")


async def drag(tab: Tab, _robot: Robot, out: Path) -> str:
    """A hand that is dragged ends under the pointer."""
    for _ in range(4):
        await tab.press("m")
    await asyncio.sleep(2.0)
    x, y = await tab.evaluate(RING)
    await tab.mouse("mousePressed", x, y)
    for part in range(1, 11):
        await tab.mouse("mouseMoved", x + 0.1 * part * WAY[0], y + 0.1 * part * WAY[1])
    await asyncio.sleep(2.0)
    await tab.screenshot(out / "drag.png")
    after = await tab.evaluate(RING)
    await tab.mouse("mouseReleased", x + WAY[0], y + WAY[1])
    off = max(abs(after[0] - x - WAY[0]), abs(after[1] - y - WAY[1]))
    if off > 6.0:
        raise CheckError(f"expected the hand under the pointer, it is off by {off:.0f} pixels")
    return f"off by {off:.1f} pixels"


async def reload(tab: Tab, robot: Robot, _out: Path) -> str:
    """A reload in the middle of a gait: it ends, the robot stands, and nobody has it."""
    before = robot.latest(WBC_STATE)
    done = 0 if before is None else before.gaits_completed
    await tab.press("a")
    await until(lambda: _state(robot) in {ControlState.LF_SWING, ControlState.RF_SWING}, "a swing")
    await tab.call("Page.reload")
    await until(lambda: _change(robot) is AuthorityChange.EXPIRED, "the lease to end")
    await until(lambda: _state(robot) is ControlState.BALANCE, "balance")
    state, status = robot.latest(WBC_STATE), robot.latest(PLANT_STATUS)
    if state is None or status is None or status.fallen or state.gaits_completed != done + 1:
        raise CheckError("the robot fell, or did not complete the gait")
    await asyncio.sleep(1.0)
    return f"the gait was completed; {await text(tab, 'who')}"


async def stop(tab: Tab, robot: Robot, _out: Path) -> str:
    """The red button stops the robot though somebody only watches; b b and r r end it."""
    await tab.evaluate("document.getElementById('stop').click()")
    await until(lambda: _guard(robot) is GuardMode.ESTOP, "the stop")
    await asyncio.sleep(0.3)
    alarm = await text(tab, "alarm")
    for key in "bbrr":
        await tab.press(key)
        await asyncio.sleep(0.2)
    await until(lambda: _guard(robot) is GuardMode.ACTIVE, "the end of the stop")
    return alarm


def _holder(robot: Robot) -> str:
    said = robot.latest(WBC_AUTHORITY)
    return "" if said is None else said.holder


def _change(robot: Robot) -> AuthorityChange | None:
    said = robot.latest(WBC_AUTHORITY)
    return None if said is None else said.change


def _state(robot: Robot) -> ControlState | None:
    state = robot.latest(WBC_STATE)
    return None if state is None else state.state


def _guard(robot: Robot) -> GuardMode | None:
    status = robot.latest(PLANT_STATUS)
    return None if status is None else status.guard


CHECKS = (pictures, take, drag, reload, stop)
