"""The keyboard operator's screen: at most 80 by 24 characters; pure."""

from dataclasses import dataclass
from math import degrees, inf

from common.schemas import ControllerState, GuardMode, OperatorStatus, PlantStatus
from services.teleop.keyboard.console import Console
from services.teleop.keyboard.keymap import KEYMAP
from services.teleop.targets.hand import SIDES, hand_rpy

WIDTH, HEIGHT = 80, 24
HELP_COLUMNS = 3
HELP_ROWS = -(-len(KEYMAP) // HELP_COLUMNS)
BOLD, RED, PLAIN = "\x1b[1m", "\x1b[1;31m", "\x1b[0m"


@dataclass(frozen=True)
class Feedback:
    """Latest messages of the robot, and their ages [s] (infinity: none yet).

    Attributes:
        controller, controller_age: last controller state.
        plant, plant_age: last plant status.
        script: status of another operator that plays a script; None: none.
        falls: falls since this operator started.
        picture_delay: delay of the left camera's picture behind the robot [s]; None: no picture.
    """

    controller: ControllerState | None = None
    controller_age: float = inf
    plant: PlantStatus | None = None
    plant_age: float = inf
    script: OperatorStatus | None = None
    falls: int = 0
    picture_delay: float | None = None


def render(console: Console, feedback: Feedback, now: float) -> list[str]:
    """Return the lines of the screen, with colour codes; ``now`` is the operator's time [s]."""
    return [
        _controller_line(console, feedback),
        _tracking_line(feedback),
        _plant_line(feedback),
        _robot_line(console, feedback),
        _stop_line(console, feedback, now) or _script_line(feedback),
        "   hand      x      y      z   roll  pitch   yaw   gripper   off by",
        *(_hand_line(console, side, feedback) for side in SIDES),
        _head_line(console, feedback),
        *_gait_lines(console, now),
        f"{BOLD}{console.notice[:WIDTH]}{PLAIN}",
        *help_lines(),
    ]


def help_lines() -> list[str]:
    """Return all keys and what they do, in columns."""
    width = WIDTH // HELP_COLUMNS
    cells = [f" {binding.label:>7} {binding.help}" for binding in KEYMAP]
    return [
        "".join(f"{cell:<{width}}" for cell in cells[row::HELP_ROWS]).rstrip()
        for row in range(HELP_ROWS)
    ]


def _age(age: float) -> str:
    return "never heard" if age == inf else f"{1e3 * age:.0f} ms ago"


def _controller_line(console: Console, feedback: Feedback) -> str:
    state, age = feedback.controller, _age(feedback.controller_age)
    if state is None:
        return f"controller  {RED}{age}{PLAIN}"
    doing = f" {state.gait.name.lower()} {100 * state.gait_progress:.0f} %" if state.gait else ""
    stale = console.claimant.has_robot and not state.setpoint_fresh
    held = f"  {RED}SET-POINTS STALE: HANDS HELD{PLAIN}" if stale else ""
    return (
        f"controller  {BOLD}{state.state.name}{PLAIN}{doing}  "
        f"{state.gaits_completed} gaits done  {age}{held}"
    )


def _tracking_line(feedback: Feedback) -> str:
    state = feedback.controller
    if state is None:
        return ""
    return (
        f"            DCM off by {1e3 * state.dcm_error:.1f} mm  {state.solver} "
        f"{state.unsolved} unsolved"
    )


def _plant_line(feedback: Feedback) -> str:
    plant, age = feedback.plant, _age(feedback.plant_age)
    if plant is None:
        return f"plant       {RED}{age}{PLAIN}"
    marks = [name for name, on in (("FALLEN", plant.fallen), ("PAUSED", plant.paused)) if on]
    return (
        f"plant       {BOLD}{plant.guard.name}{PLAIN} {RED}{' '.join(marks)}{PLAIN} "
        f"pace {plant.real_time_factor:.2f}x  falls {feedback.falls}  torque from state "
        f"{1e3 * plant.age_at_torque_median:.0f}/{1e3 * plant.age_at_torque_p99:.0f} ms old  {age}"
    )


def _robot_line(console: Console, feedback: Feedback) -> str:
    claimant, state = console.claimant, console.claimant.authority
    if state is None:
        return f"robot       {RED}no controller has said who has it{PLAIN}"
    who = "YOU have" if claimant.has_robot else f"{claimant.holder or 'nobody'} has"
    since = ""
    if feedback.controller is not None:
        ago = max(0.0, 1e-9 * (feedback.controller.header.stamp - state.since))
        since = f" ({ago:.0f} s ago)"
    waiting = f"; waiting: {', '.join(state.waiting)}" if state.waiting else ""
    text = f"{who} it: {state.reason}{since * (state.changes > 0)}{waiting}"
    return f"robot       {BOLD}{text[: WIDTH - 12]}{PLAIN}"


def _stop_line(console: Console, feedback: Feedback, now: float) -> str:
    pressed_ns, plant = console.button.pressed_ns, feedback.plant
    if pressed_ns is not None:
        waited = now - 1e-9 * pressed_ns
        text = f"STOP SENT, NOT CONFIRMED for {waited:.1f} s: does the plant run?"
    elif plant is not None and plant.guard is GuardMode.ESTOP:
        text = f"STOPPED by {plant.stopped_by or 'somebody'}"
        how = " - b b ends the stop"
        text += f": {plant.stop_reason}"[: WIDTH - len(text) - len(how)] + how
    else:
        return ""
    return f"{RED}{text[:WIDTH]}{PLAIN}"


def _hand_line(console: Console, side: str, feedback: Feedback) -> str:
    hand, index = console.targets.hands[side], SIDES.index(side)
    x, y, z = hand.position
    angles = "".join(f"{round(degrees(a)):+6d}°" for a in hand_rpy(hand.quaternion))
    closure = console.targets.closure[index]
    error = ""
    if feedback.controller is not None:
        error = f"{1e3 * feedback.controller.hand_position_error[index]:6.1f} mm"
    mark = ">" if side in console.selected else " "
    return f" {mark} {side:5} {x:+.3f} {y:+.3f} {z:+.3f} {angles}  {closure:5.0%}    {error}"


def _head_line(console: Console, feedback: Feedback) -> str:
    seen = (
        ""
        if feedback.picture_delay is None
        else f"   sees {1e3 * feedback.picture_delay:.0f} ms behind"
    )
    return f"   head {degrees(console.targets.neck):+7.0f}° down{seen}"


def _gait_lines(console: Console, now: float) -> list[str]:
    """Return a constant number of lines, newest request last."""
    lines = []
    for request in console.requests:
        text = request.describe(now)[: WIDTH - 12]
        lines.append(f"gait        {RED if text != text.lower() else ''}{text}{PLAIN}")
    return lines + [""] * ((console.requests.maxlen or 0) - len(lines))


def _script_line(feedback: Feedback) -> str:
    script = feedback.script
    if script is None:
        return ""
    text = f"script      {script.script} {script.step}/{script.steps} {script.label}"
    return text[:WIDTH]
