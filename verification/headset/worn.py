"""Checks of the page in a headset, which IWER emulates in the browser."""

import asyncio
from pathlib import Path

import numpy as np

from common.schemas import Gait, Setpoint
from common.schemas.arrays import Float64Array as Array
from common.topics import TELEOP_DEVICE, TELEOP_SETPOINT, WBC_STATE, WBC_TARGET
from verification.headset.chromium import Tab
from verification.headset.robot import CheckError, Robot, until

EMULATOR = """;
  window.worn = new IWER.XRDevice(IWER.metaQuest3, {stereoEnabled: true});
  worn.stereoEnabled = true;
  worn.installRuntime({forceInstall: true});
  worn.position.set(0, 1.6, 0);
  worn.controllers.left.position.set(-0.25, 1.2, -0.4);
  worn.controllers.right.position.set(0.25, 1.2, -0.4);
  window.felt = [];
  const ask = navigator.xr.requestSession.bind(navigator.xr);
  navigator.xr.requestSession = async (...how) => {
    const session = await ask(...how);
    session.addEventListener("inputsourceschange", ({added}) => {
      for (const {gamepad} of added) {
        for (const motor of gamepad.hapticActuators) motor.pulse = async (...how) => felt.push(how);
      }
    });
    return session;
  };
"""
"""Runs after IWER itself and before the page's own scripts."""
LEFT, RIGHT = "worn.controllers.left", "worn.controllers.right"
STILL = 1e-3
"""Largest motion of a hand that does not move [m]."""
STEPS = 20
PAUSE = 0.06
"""Between two steps of a motion [s]; a frame takes as long where a processor draws it."""


def hands(setpoint: Setpoint) -> Array:
    """Return the positions (6,) of both hands [m]."""
    return np.concatenate(
        [setpoint.left_hand_position_in_body, setpoint.right_hand_position_in_body]
    )


async def moved(robot: Robot, before: Array, expected: Array, what: str) -> str:
    """Say how far the hands have moved.

    Raises:
        CheckError: otherwise than expected.
    """
    await asyncio.sleep(0.5)
    way = hands(await robot.next(TELEOP_SETPOINT)) - before
    off = float(np.abs(way - expected).max())
    if off > STILL:
        raise CheckError(f"{what}: expected the hands to move by {expected}, got {way.round(4)} m")
    return f"{what}: off by {1e3 * off:.2f} mm"


async def move(tab: Tab, what: str, start: Array, way: Array) -> None:
    """Move a controller or the head in small steps [m]."""
    for part in np.linspace(0.0, 1.0, STEPS + 1)[1:]:
        x, y, z = start + part * way
        await tab.evaluate(f"{what}.position.set({x}, {y}, {z})")
        await asyncio.sleep(PAUSE)


async def button(tab: Tab, controller: str, name: str, value: float) -> None:
    """Press a button by a value from 0 to 1."""
    await tab.evaluate(f"{controller}.updateButtonValue('{name}', {value})")
    await asyncio.sleep(0.3)


async def enter(tab: Tab, robot: Robot, out: Path) -> str:
    """VR is entered by a click, and samples arrive."""
    for _ in range(100):
        if await tab.evaluate("!document.getElementById('enter-vr').hidden"):
            break
        await asyncio.sleep(0.1)
    else:
        raise CheckError("expected the button Enter VR, but no headset is offered")
    await tab.evaluate("document.getElementById('enter-vr').click()")
    await asyncio.sleep(2.0)
    await tab.screenshot(out / "headset.png")
    # Samples are published once a person drives.
    before = robot.latest(WBC_TARGET)
    await button(tab, RIGHT, "squeeze", 1.0)
    await robot.next(TELEOP_DEVICE)
    if before is None:
        raise CheckError("the controller has published no target")
    return await moved(robot, hands(before), np.zeros(6), "engaging")


async def follow(tab: Tab, robot: Robot, _out: Path) -> str:
    """A hand follows its controller, the other one stays."""
    before = hands(await robot.next(TELEOP_SETPOINT))
    await move(tab, RIGHT, np.array([0.25, 1.2, -0.4]), np.array([0.0, 0.1, -0.05]))
    return await moved(robot, before, np.array([0, 0, 0, 0.05, 0, 0.1]), "10 cm up, 5 ahead")


async def look(tab: Tab, robot: Robot, out: Path) -> str:
    """The head moves no hand."""
    before = hands(await robot.next(TELEOP_SETPOINT))
    await move(tab, "worn", np.array([0.0, 1.6, 0.0]), np.array([0.2, -0.1, 0.1]))
    await tab.evaluate("worn.quaternion.set(0, Math.sin(0.25), 0, Math.cos(0.25))")
    told = await moved(robot, before, np.zeros(6), "head moved by 24 cm and turned by 29°")
    # Down to the hands; the robot's head follows.
    await tab.evaluate("worn.quaternion.set(Math.sin(-0.3), 0, 0, Math.cos(0.3))")
    await asyncio.sleep(2.0)
    await tab.screenshot(out / "looking-down.png")
    await moved(robot, before, np.zeros(6), "head pitched down by 34°")
    await tab.evaluate("worn.quaternion.set(0, 0, 0, 1)")
    return told


async def reach_back(tab: Tab, robot: Robot, _out: Path) -> str:
    """With the clutch let go the controller moves alone, and engaging anew moves nothing."""
    before = hands(await robot.next(TELEOP_SETPOINT))
    await button(tab, RIGHT, "squeeze", 0.0)
    await move(tab, RIGHT, np.array([0.25, 1.3, -0.45]), np.array([0.1, -0.4, 0.2]))
    await button(tab, RIGHT, "squeeze", 1.0)
    return await moved(robot, before, np.zeros(6), "engaging anew")


async def menu(tab: Tab, robot: Robot, _out: Path) -> str:
    """Behind the headset's menu the clutch lets go."""
    before = hands(await robot.next(TELEOP_SETPOINT))
    await tab.evaluate("worn.updateVisibilityState('visible-blurred')")
    await move(tab, RIGHT, np.array([0.35, 0.9, -0.25]), np.array([0.0, 0.3, 0.0]))
    await tab.evaluate("worn.updateVisibilityState('visible')")
    return await moved(robot, before, np.zeros(6), "behind a menu")


async def refusal(tab: Tab, robot: Robot, _out: Path) -> str:
    """A gait that is refused is felt, and the one before it ends well."""
    await button(tab, LEFT, "x-button", 1.0)
    await button(tab, LEFT, "x-button", 0.0)
    await until(lambda: _gait(robot) is Gait.TURN_LEFT, "the gait")
    await tab.evaluate("felt.length = 0")
    await button(tab, LEFT, "y-button", 1.0)
    await button(tab, LEFT, "y-button", 0.0)
    for _ in range(50):
        if felt := await tab.evaluate("felt"):
            break
        await asyncio.sleep(0.1)
    else:
        raise CheckError("expected pulses of the controllers, felt none")
    await until(lambda: _gait(robot) is Gait.NONE, "the end of the gait")
    return f"{len(felt)} pulses of {felt[0]}"


def _gait(robot: Robot) -> Gait | None:
    state = robot.latest(WBC_STATE)
    return None if state is None else state.gait


CHECKS = (enter, follow, look, reach_back, menu, refusal)
