"""Format the status of controller, plant and scored task as text."""

from rich.text import Text

from common.schemas import (
    AuthorityState,
    ControllerState,
    GuardMode,
    PlantStatus,
    PolicyMode,
    PolicyState,
    TaskStatus,
    TaskVerdict,
)
from common.topics import TELEOP_SETPOINT
from lab.monitor.bus_stats import Snapshot
from lab.monitor.ledger_text import short_ms

SILENCE = "nothing heard yet (services take some seconds to start; is this the right base port?)"

MAX_WARNINGS = 3
"""Lines that warnings take at most."""

_STYLES = {
    TaskVerdict.RUNNING: "",
    TaskVerdict.SUCCESS: "bold green",
    TaskVerdict.PARTIAL: "yellow",
    TaskVerdict.FAILURE: "bold red",
}


def format_line(view: Snapshot) -> str:
    """Format the most important figures in one line, for output that is not a terminal."""
    if not view.topics:
        return SILENCE
    parts = []
    if view.operator is not None:
        parts.append(f"step {view.operator.step}/{view.operator.steps} {view.operator.label!r}")
    if view.task is not None:
        parts.append(format_task(view.task))
    if view.control is not None:
        parts.append(format_controller(view.control))
    if view.plant is not None:
        parts.append(format_plant(view.plant))
    if view.authority is not None:
        parts.append(format_authority(view.authority, view.plant))
    if view.policy is not None:
        parts.append(f"policy {format_policy(view.policy)}")
    dead = [row.health.service for row in view.services if not row.alive]
    if dead:
        parts.append(f"silent: {', '.join(dead)}")
    stale = [row.name for row in view.topics if row.stale]
    if stale:
        parts.append(f"stale: {', '.join(stale)}")
    for row in view.ledger:
        total = next((s for s in row.health.stages if s.stage == "total"), None)
        if row.health.topic == TELEOP_SETPOINT.name and total is not None:
            parts.append(
                f"set-point to {row.consumer} {short_ms(total.median)}/{short_ms(total.p99)} ms"
            )
    parts += warnings(view)
    rows = view.topics
    misses = sum(row.health.deadline_misses for row in view.services)
    parts.append(
        f"gaps {sum(row.gaps for row in rows)}, late {sum(row.late for row in rows)}, "
        f"repeated {sum(row.repeated for row in rows)}, "
        f"too old {sum(row.too_old for row in rows)}, deadline misses {misses}"
    )
    return " | ".join(parts)


def warnings(view: Snapshot) -> list[str]:
    """Return what a person should mend: doubled services, and whom their readers ignore."""
    alive = [row.health for row in view.services if row.alive]
    lines = [
        f"{health.service}: {health.conflict} is on the bus too; stop one"
        for health in alive
        if health.conflict
    ]
    lines += [
        f"{health.service} ignored {link.foreign} of {link.topic}: {link.last_refusal}"
        for health in alive
        for link in health.links
        if link.foreign
    ]
    return lines[:MAX_WARNINGS]


def format_controller(control: ControllerState) -> str:
    """Format state, gait and errors of the controller."""
    gait = ""
    if control.gait:
        gait = f", {control.gait.name.lower()} {100 * control.gait_progress:.0f} %"
    trouble = f", {control.obstacle}" if control.obstacle else ""
    return (
        f"{control.state.name}{gait}, {control.gaits_completed} gaits done, "
        f"hand error {1e3 * max(control.hand_position_error):.0f} mm, "
        f"DCM error {1e3 * control.dcm_error:.0f} mm{trouble}"
    )


def format_plant(plant: PlantStatus) -> str:
    """Format stop, guard, pace and state age of the plant, and whom it does not obey."""
    state = f"{format_stop(plant)}, " if plant.guard is GuardMode.ESTOP else ""
    state += "FALLEN, " if plant.fallen else ""
    state += "paused, " if plant.paused else ""
    held = plant.guard in {GuardMode.SILENT, GuardMode.HOLD} and plant.last_refusal
    why = f" (refused {plant.last_refusal})" if held else ""
    foreign = ""
    if plant.commands_foreign:
        foreign = f", {plant.commands_foreign} commands of another controller refused"
        foreign += f", last {plant.last_refusal}" if plant.last_refusal and not held else ""
    return (
        f"{state}guard {plant.guard.name}{why}, real-time factor {plant.real_time_factor:.2f}, "
        f"state age at torque {1e3 * plant.age_at_torque_median:.1f} ms "
        f"(p99 {1e3 * plant.age_at_torque_p99:.1f}){foreign}"
    )


def format_stop(plant: PlantStatus) -> str:
    """Format who has stopped the robot, and why."""
    reason = f": {plant.stop_reason}" if plant.stop_reason else ""
    return f"STOPPED by {plant.stopped_by or 'somebody'}{reason} (trill resume)"


def format_authority(authority: AuthorityState, plant: PlantStatus | None) -> str:
    """Format which operator has the robot, since when and why, and who waits for it."""
    text = f"{authority.holder or 'nobody'} has the robot"
    if authority.holder:
        text += f" ({authority.kind.name.lower()})"
    if authority.changes:
        since = 0 if plant is None else plant.header.stamp - authority.since
        ago = f"{1e-9 * since:.0f} s ago" if since > 0 else ""
        text += f", {ago}: {authority.reason}" if ago else f": {authority.reason}"
    if authority.waiting:
        text += f"; waiting: {', '.join(authority.waiting)}"
    if authority.ignored:
        text += f"; messages of others ignored: {authority.ignored}"
    return text


def format_policy(policy: PolicyState) -> str:
    """Format what a policy does, its ages and delays, and the answers that it dropped."""
    times = {
        "picture": policy.picture_age,
        "delay": policy.delay,
        # In its own step the inference takes no time of the runner's clock.
        "answer": policy.round_trip if policy.inference >= 0.0 else -1.0,
        "inference": policy.inference,
    }
    known = [f"{name} {1e3 * value:.0f} ms" for name, value in times.items() if value >= 0.0]
    counts = {
        "late": policy.late,
        "not asked for": policy.unasked,
        "refused": policy.refused,
        "requests without an answer": policy.unanswered,
    }
    dropped = [f"{name} {count}" for name, count in counts.items() if count]
    skipped = f", {policy.compensated} steps skipped" if policy.compensated else ""
    # The label says the mode, except while all is well.
    said = policy.label if policy.mode is not PolicyMode.OK else "ok"
    return (
        f"{policy.policy} {policy.checkpoint[:8]} {said}, {policy.answers} answers, "
        f"{', '.join(known) or 'no times yet'}{skipped}"
        + (f"; dropped: {', '.join(dropped)}" if dropped else "")
    )


def policy_line(policy: PolicyState) -> Text:
    """Format the same as a coloured line of the table."""
    style = {PolicyMode.OK: "", PolicyMode.WAITING: "dim", PolicyMode.DEGRADED: "yellow"}
    return Text.assemble(
        ("policy      ", "dim"),
        (format_policy(policy), style.get(policy.mode, "bold red")),
        no_wrap=True,
        overflow="ellipsis",
    )


def format_task(task: TaskStatus) -> str:
    """Format task, time, verdict, stages and undesired contacts in one line."""
    return f"{_trial(task)} {_verdict(task)}, {_stages(task)}, {_undesired(task)}"


def task_line(task: TaskStatus) -> Text:
    """Format the same as a coloured line of the table."""
    return Text.assemble(
        ("task        ", "dim"),
        f"{_trial(task)}  ",
        (_verdict(task), _STYLES[task.verdict]),
        f"  {_stages(task)}  ",
        (_undesired(task), "yellow" if task.undesired else "dim"),
        no_wrap=True,
        overflow="ellipsis",
    )


def _trial(task: TaskStatus) -> str:
    return f"{task.task} seed {task.seed}  {task.time:.1f}/{task.limit:g} s"


def _verdict(task: TaskStatus) -> str:
    reason = "" if task.verdict is TaskVerdict.SUCCESS else task.reason
    return task.verdict.name + (f": {reason}" if reason else "")


def _stages(task: TaskStatus) -> str:
    done = [stage.name for stage in task.stages if stage.done]
    open_stages = [stage.name for stage in task.stages if not stage.done]
    text = f"stage {len(done)}/{len(task.stages)}"
    if done:
        text += f": {done[-1]}"
    running = task.verdict is TaskVerdict.RUNNING
    return f"{text}, next: {open_stages[0]}" if open_stages and running else text


def _undesired(task: TaskStatus) -> str:
    names = ", ".join(contact.name for contact in task.undesired)
    return f"undesired: {names}" if names else "no undesired contact"
