"""Numbers of the summary of a run whose numbers are known."""

from math import pi

import pytest

from common.robot.pose import Pose2
from common.schemas import (
    AuthorityChange,
    AuthorityState,
    Estop,
    EstopClear,
    Gait,
    GaitOutcome,
    GuardMode,
    Header,
    OperatorKind,
)
from common.topics import ESTOP, ESTOP_CLEAR, HEALTH, PLANT_STATE, PLANT_TRUTH, WBC_AUTHORITY
from lab.review.key_moments import key_moments
from lab.review.report import report_lines
from lab.review.run_summary import Quantiles, RunSummary
from lab.review.scoring import commanded_motions
from lab.review.summary import summarise
from lab.review.summary_readers import LogFindings
from lab.review.timeline import read_timeline
from services.wbc.config import GaitConfig
from tests.common.operator.support import said
from tests.lab.review.synthetic import MS, FakeRobot, Pair

ACCEPTED, COMPLETED = GaitOutcome.ACCEPTED, GaitOutcome.COMPLETED


def test_gait_motion_is_measured_in_the_heading_at_its_start() -> None:
    robot = FakeRobot()
    summary = summarise(robot.gait(7, Gait.FORWARD, (1.0, 2.0, pi / 2), (1.01, 2.19, pi / 2)))
    (run,) = summary.gait_runs
    assert (run.request_id, run.gait, run.outcome) == (7, "forward", "completed")
    assert run.forward == pytest.approx(0.19, abs=1e-9)
    assert run.left == pytest.approx(-0.01, abs=1e-9)
    assert run.turn_deg == pytest.approx(0.0, abs=1e-9)
    assert run.commanded_forward == 0.2
    assert run.duration == pytest.approx(3.0)


def test_a_turn_on_the_spot_is_no_distance() -> None:
    robot = FakeRobot()
    summary = summarise(robot.gait(0, Gait.TURN_LEFT, (0.3, 0.1, 0.0), (0.3, 0.1, 0.3)))
    (run,) = summary.gait_runs
    assert run.turn_deg == pytest.approx(0.3 * 180 / pi)
    assert abs(run.forward) < 1e-12
    assert summary.walk.distance < 1e-12


def test_walk_composes_the_commands_of_completed_gaits() -> None:
    robot = FakeRobot()
    quarter = pi / 2
    messages = [
        robot.settings(GaitConfig(forward_step=0.2, turn_angle=quarter)),
        *robot.gait(0, Gait.FORWARD, (0, 0, 0), (0.2, 0, 0)),
        *robot.gait(1, Gait.TURN_LEFT, (0.2, 0, 0), (0.2, 0, quarter)),
        *robot.gait(2, Gait.FORWARD, (0.2, 0, quarter), (0.2, 0.17, quarter)),
        robot.ask(3, Gait.FORWARD),
        robot.answer(3, Gait.FORWARD, GaitOutcome.REFUSED, "not balancing"),
    ]
    walk = summarise(messages).walk
    assert (walk.commanded_forward, walk.commanded_left) == pytest.approx((0.2, 0.2))
    assert (walk.forward, walk.left) == pytest.approx((0.2, 0.17))
    assert (walk.turn_deg, walk.commanded_turn_deg) == pytest.approx((90.0, 90.0))
    assert walk.end_error == pytest.approx(0.03)
    assert (walk.distance, walk.commanded_distance) == pytest.approx((0.37, 0.4))


def test_turns_add_up_beyond_half_a_turn() -> None:
    robot, turn = FakeRobot(), pi / 2
    messages = [
        pair
        for number in range(3)
        for pair in robot.gait(
            number, Gait.TURN_LEFT, (0, 0, number * turn), (0, 0, (number + 1) * turn)
        )
    ]
    walk = summarise([*messages, robot.settings(GaitConfig(turn_angle=turn))]).walk
    assert (walk.turn_deg, walk.commanded_turn_deg) == pytest.approx((270.0, 270.0))
    assert walk.end_error == pytest.approx(0.0, abs=1e-12)


def test_a_gait_that_did_not_end_is_not_part_of_the_walk() -> None:
    robot = FakeRobot()
    unended = list(robot.gait(1, Gait.FORWARD, (0.2, 0, 0), (0.3, 0, 0)))[:-1]
    walk = summarise([*robot.gait(0, Gait.FORWARD, (0, 0, 0), (0.2, 0, 0)), *unended]).walk
    assert (walk.forward, walk.commanded_forward) == pytest.approx((0.2, 0.2))


def test_gaits_are_counted_by_type_and_outcome() -> None:
    robot = FakeRobot()
    messages = [
        robot.ask(0, Gait.FORWARD),
        robot.ask(0, Gait.FORWARD),  # sent again, still one request
        robot.answer(0, Gait.FORWARD, GaitOutcome.REFUSED, "walking"),
        robot.answer(0, Gait.FORWARD, GaitOutcome.ACCEPTED),
        robot.answer(0, Gait.FORWARD, GaitOutcome.COMPLETED),
        robot.ask(1, Gait.SIDE_LEFT),
        robot.answer(1, Gait.SIDE_LEFT, GaitOutcome.ACCEPTED),
        robot.answer(1, Gait.SIDE_LEFT, GaitOutcome.ABORTED, "fell"),
        robot.ask(2, Gait.FORWARD),
        robot.ask(0, Gait.FORWARD, boot=2),  # a restarted operator counts from 0 again
    ]
    summary = summarise(messages)
    forward, side = summary.gaits["forward"], summary.gaits["side_left"]
    assert (forward.requested, forward.accepted, forward.completed) == (3, 1, 1)
    assert (forward.refused, forward.aborted) == (1, 0)
    assert (side.requested, side.accepted, side.completed, side.aborted) == (1, 1, 0, 1)
    assert summary.gaits["total"].requested == 4
    assert [run.outcome for run in summary.gait_runs] == [
        "completed",
        "aborted",
        "requested",
        "requested",
    ]
    assert summary.gait_runs[1].reason == "fell"


def test_an_answer_recorded_before_its_request_is_still_its_answer() -> None:
    robot = FakeRobot()
    messages = [
        robot.answer(4, Gait.TURN_RIGHT, GaitOutcome.ACCEPTED),
        robot.ask(4, Gait.TURN_RIGHT),
        robot.answer(4, Gait.TURN_RIGHT, GaitOutcome.COMPLETED),
    ]
    (run,) = summarise(messages).gait_runs
    assert run.outcome == "completed"


def test_a_fall_overrules_a_completed_run_but_not_another_verdict() -> None:
    robot = FakeRobot()
    messages = [
        robot.status(),
        robot.status(fallen=True),
        robot.status(fallen=True),
        robot.status(),
    ]
    assert summarise(messages).outcome == "fell"
    assert summarise(messages).plant.falls == 1
    assert summarise(messages, outcome="interrupted").outcome == "interrupted"
    assert summarise([robot.status()]).outcome == "completed"


def test_plant_numbers() -> None:
    robot = FakeRobot()
    messages = []
    for index in range(30):
        robot.now += 100
        messages.append(robot.plant(PLANT_STATE, 0.0, 0.0, 0.0))
        messages.append(robot.status(factor=0.8 if index == 20 else 1.0, age=0.001 * (index + 1)))
    plant = summarise(messages).plant
    assert plant.age_at_torque_median_ms == pytest.approx(15.5)
    assert plant.age_at_torque_p99_ms == pytest.approx(31.0)
    assert plant.age_at_torque_p99_worst_ms == pytest.approx(60.0)
    assert plant.real_time_factor == pytest.approx(1.0)
    assert plant.real_time_factor_worst == pytest.approx(0.8)
    assert (plant.commands_refused, plant.holds, plant.late_steps) == (2, 1, 3)
    assert plant.saturated_fraction == pytest.approx(0.25)


def later_life(pairs: list[Pair], boot: int = 2) -> list[Pair]:
    """The same messages from a restarted plant, whose robot time begins anew."""
    first = pairs[0][1].header.stamp
    return [
        (
            topic,
            one.model_copy(
                update={
                    "header": one.header.model_copy(
                        update={"boot": boot, "stamp": one.header.stamp - first}
                    )
                }
            ),
        )
        for topic, one in pairs
    ]


def test_a_restarted_plant_is_summed_up_over_all_its_lives() -> None:
    robot = FakeRobot()

    def seconds(count: int) -> list[Pair]:
        found = [
            robot.plant(PLANT_STATE, 0, 0, 0),
            robot.wbc(),
            robot.health("sim", misses=1, median=0.001, p99=0.002),
        ]
        for _ in range(10 * count):
            robot.now += 100
            found += [robot.plant(PLANT_STATE, 0, 0, 0), robot.status()]
        return found

    messages = seconds(8)
    robot.now += 30_000  # nobody ran the plant
    messages += later_life(seconds(3))
    summary = summarise(messages)
    plant = summary.plant
    assert summary.duration == pytest.approx(11.0)
    assert (plant.lives, plant.holds, plant.commands_applied, plant.late_steps) == (2, 2, 200, 6)
    assert plant.real_time_factor == pytest.approx(1.0)
    assert (summary.services["sim"].lives, summary.services["sim"].steps) == (2, 2000)
    assert summary.services["sim"].deadline_misses == 2
    # Rates are those of the time in which the plant ran.
    assert summary.topics["plant/state"].rate == pytest.approx(10.0)


def test_a_restart_of_the_plant_is_no_walking() -> None:
    robot = FakeRobot()
    first = list(robot.gait(0, Gait.FORWARD, (0, 0, 0), (0.2, 0, 0)))
    second = later_life(list(robot.gait(1, Gait.FORWARD, (0, 0, 0), (0.19, 0, 0))))
    messages = [*first, *second]
    walk = summarise(messages).walk
    assert (walk.forward, walk.commanded_forward) == pytest.approx((0.39, 0.4))
    assert walk.end_error == pytest.approx(0.01)
    timeline = read_timeline(messages)
    times = [timeline.seconds_at(index) for index in range(len(timeline.truth))]
    assert times == sorted(times)
    assert times[-1] == pytest.approx(6.0)


def test_a_reply_answers_the_request_of_the_operator_that_it_names() -> None:
    robot = FakeRobot()

    def reply(outcome: GaitOutcome, boot: int) -> Pair:
        topic, one = robot.answer(0, Gait.FORWARD, outcome)
        return topic, one.model_copy(update={"requester_boot": boot})

    runs = summarise(
        [
            robot.ask(0, Gait.FORWARD, boot=1),
            robot.ask(0, Gait.FORWARD, boot=2),
            reply(ACCEPTED, 1),
            reply(GaitOutcome.REFUSED, 2),
            reply(COMPLETED, 1),
        ]
    ).gait_runs
    assert [run.outcome for run in runs] == ["completed", "refused"]


def test_stops_and_hand_overs_are_events_once_each() -> None:
    robot = FakeRobot()

    def state(changes: int, change: AuthorityChange, holder: str, previous: str) -> Pair:
        return WBC_AUTHORITY, AuthorityState(
            header=robot.header(WBC_AUTHORITY, "wbc"),
            holder=holder,
            holder_boot=1,
            kind=OperatorKind.PERSON,
            changes=changes,
            change=change,
            previous=previous,
            previous_boot=2,
            since=0,
        )

    def button(*, pressed: bool) -> Pair:
        header = robot.header(ESTOP, "keyboard")
        return ESTOP, Estop(header=header, reason="key x", pressed=pressed)

    topic, stopped = robot.status()
    stopped = stopped.model_copy(
        update={"stops": 1, "stopped_by": "keyboard", "stop_reason": "key x"}
    )
    messages = [
        robot.plant(PLANT_STATE, 0, 0, 0),
        state(0, AuthorityChange.NONE, "", ""),
        *[state(1, AuthorityChange.GRANTED, "script", "")] * 3,
        *[state(2, AuthorityChange.TAKEN, "keyboard", "script")] * 3,
        *[button(pressed=False)] * 3,
        *[button(pressed=True)] * 3,
        robot.status(),
        *[(topic, stopped)] * 3,
        state(3, AuthorityChange.STOPPED, "", "keyboard"),
        (
            ESTOP_CLEAR,
            EstopClear(header=robot.header(ESTOP_CLEAR, "keyboard"), stops=1, reason="key r"),
        ),
        button(pressed=False),
    ]
    summary = summarise(messages)
    assert [event.text for event in summary.events] == [
        "script has the robot (granted)",
        "keyboard has the robot (taken), before that script",
        "EMERGENCY STOP by keyboard: key x",
        "plant stopped by keyboard (stop 1): key x",
        "nobody has the robot (stopped), before that keyboard",
        "emergency stop 1 cleared by keyboard: key r",
    ]
    assert summary.plant.stops == 1


def test_interventions_have_their_times_in_summary_report_and_moments() -> None:
    robot = FakeRobot()
    person = OperatorKind.PERSON
    messages: list[Pair] = []
    for number in range(60):
        robot.now += 100
        for topic in (PLANT_STATE, PLANT_TRUTH):
            messages.append(robot.plant(topic, 0, 0, 0))
        if number in {0, 20, 45}:
            change = {
                0: said(1, AuthorityChange.GRANTED, "policy"),
                20: said(2, AuthorityChange.TAKEN, "keyboard", person),
                45: said(3, AuthorityChange.TAKEN, "policy"),
            }[number]
            messages.append((WBC_AUTHORITY, change))
    summary = summarise(messages)
    (one,) = summary.interventions
    assert (one.operator, one.at, one.length) == ("keyboard (person)", 2.0, 2.5)
    assert "interventions  2.0 s: keyboard (person) for 2.5 s, until it was taken" in report_lines(
        summary
    )
    moments = {m.index: m.label for m in key_moments(read_timeline(messages), spare=1)}
    assert moments == {0: "", 20: "keyboard takes over", 45: "back to policy", 59: ""}


def test_a_stop_counts_once_in_two_lives_and_not_at_all_if_it_was_over_before() -> None:
    robot = FakeRobot()
    topic, status = robot.status()
    over = status.model_copy(update={"stops": 2, "stopped_by": "keyboard"})
    stop = {"stops": 3, "stopped_by": "keyboard", "guard": GuardMode.ESTOP}
    stopped = status.model_copy(update=stop)
    header = status.header.model_copy(update={"boot": status.header.boot + 1})
    restarted = stopped.model_copy(update={"header": header})
    summary = summarise([robot.plant(PLANT_STATE, 0, 0, 0), (topic, over), (topic, over)])
    assert (summary.plant.stops, summary.events) == (0, [])
    both = [robot.plant(PLANT_STATE, 0, 0, 0), (topic, over), (topic, stopped), (topic, restarted)]
    assert summarise(both).plant.stops == 1
    only = summarise([robot.plant(PLANT_STATE, 0, 0, 0), (topic, stopped)])
    assert only.plant.stops == 1
    assert [event.text for event in only.events] == ["plant stopped by keyboard (stop 3)"]


def test_real_time_factor_compares_robot_time_with_the_senders_clock() -> None:
    robot = FakeRobot()
    _, first = robot.plant(PLANT_STATE, 0.0, 0.0, 0.0)
    robot.now += 5000
    topic, last = robot.plant(PLANT_STATE, 0.0, 0.0, 0.0)
    header = last.header.model_copy(update={"sent": first.header.sent + 10_000 * MS})
    last = last.model_copy(update={"header": header})
    summary = summarise([(topic, first), (topic, last), robot.status()])
    assert summary.plant.real_time_factor == pytest.approx(0.5)
    assert summary.duration == pytest.approx(5.0)


def test_services_keep_totals_and_the_worst_window() -> None:
    robot = FakeRobot()
    messages = [
        robot.health("wbc", misses=1, median=0.001, p99=0.004),
        robot.health("wbc", misses=5, median=0.003, p99=0.009),
        robot.health("wbc", misses=5, median=0.002, p99=0.003),
        robot.health("sim", misses=0, median=0.001, p99=0.001),
    ]
    services = summarise(messages).services
    assert list(services) == ["sim", "wbc"]
    wbc = services["wbc"]
    assert wbc.deadline_misses == 5
    assert wbc.step_median_ms == pytest.approx(2.0)
    assert (wbc.step_p99_ms, wbc.step_p99_worst_ms) == pytest.approx((4.0, 9.0))
    assert (wbc.input_gaps, wbc.input_refused) == (2, 1)


def test_topics_have_rates_per_source_and_life_and_the_losses_that_the_log_counts() -> None:
    robot = FakeRobot()
    messages = []
    for index in range(11):
        messages.append(robot.plant(PLANT_STATE, 0.0, 0.0, 0.0, skip=3 if index == 5 else 0))
        robot.now += 10
    messages += [robot.health(name, misses=0, median=0, p99=0) for name in ("a", "b", "a")]
    restarted = Header(seq=0, boot=2, source="sim", sent=robot.now * MS)
    topic, state = messages[0]
    messages.append((topic, state.model_copy(update={"header": restarted})))
    topics = summarise(
        messages,
        about_log=lambda: LogFindings(
            lost={"plant/state": 3},
            dropped={"camera/left": 4, "plant/state": 1},
            refused={"plant/state": 2},
        ),
    ).topics
    assert topics["plant/state"].messages == 12
    assert topics["plant/state"].gaps == 3
    assert (topics["plant/state"].dropped, topics["plant/state"].undecodable) == (1, 2)
    assert topics["plant/state"].rate == pytest.approx(100.0, rel=0.02)
    assert topics[HEALTH.name].gaps == 0
    assert topics[HEALTH.name].nominal_rate == 2 * HEALTH.rate
    assert (topics["camera/left"].messages, topics["camera/left"].dropped) == (0, 4)


def test_hand_errors_count_only_while_setpoints_are_fresh() -> None:
    robot = FakeRobot()
    messages = [robot.wbc(hand=(0.002, 0.004)) for _ in range(10)]
    messages += [robot.wbc(hand=(0.5, 0.5), fresh=False)]
    tracking = summarise(messages).tracking
    assert tracking.hand_position_mm.samples == 20
    assert tracking.hand_position_mm.maximum == pytest.approx(4.0)
    assert tracking.hand_position_mm.median == pytest.approx(3.0)
    assert tracking.solver == "daqp"


def test_an_empty_log_is_a_summary_too() -> None:
    summary = summarise([], outcome="service died", reason="wbc ended")
    assert summary.duration == 0.0
    assert summary.gaits["total"].requested == 0
    again = RunSummary.model_validate_json(summary.model_dump_json())
    assert again == summary


def test_quantiles() -> None:
    assert Quantiles.of([]).samples == 0
    measured = Quantiles.of(float(value) for value in range(101))
    assert (measured.samples, measured.median) == (101, 50.0)
    assert (measured.p99, measured.maximum) == (99.0, 100.0)


def test_commanded_motions_follow_the_configuration() -> None:
    motions = commanded_motions(GaitConfig(side_step=0.07))
    assert motions[Gait.SIDE_RIGHT] == Pose2(y=-0.07)
    assert motions[Gait.BACKWARD].x == -GaitConfig().backward_step


def test_a_run_is_scored_by_the_settings_that_its_controller_recorded() -> None:
    robot = FakeRobot()
    settings = robot.settings(GaitConfig(forward_step=0.15))
    gait = list(robot.gait(0, Gait.FORWARD, (0, 0, 0), (0.14, 0, 0)))
    summary = summarise([settings, *gait])
    assert summary.gait_runs[0].commanded_forward == 0.15
    assert summary.walk.end_error == pytest.approx(0.01)
    assert read_timeline([settings, *gait]).commanded[Gait.FORWARD] == Pose2(x=0.15)


@pytest.mark.parametrize(
    "change",
    [
        {"service": "sim"},
        {"settings": ""},
        {"settings": "not JSON"},
        {"settings": '{"gaits": {}}'},
        {"settings": '{"gait": {"forward_stride": 0.3}}'},
    ],
    ids=str,
)
def test_without_usable_settings_a_run_is_scored_by_the_default(change: dict[str, str]) -> None:
    robot = FakeRobot()
    topic, journal = robot.settings(GaitConfig(forward_step=0.15))
    gait = robot.gait(0, Gait.FORWARD, (0, 0, 0), (0.2, 0, 0))
    summary = summarise([(topic, journal.model_copy(update=change)), *gait])
    assert summary.gait_runs[0].commanded_forward == GaitConfig().forward_step == 0.2


def resent(robot: FakeRobot) -> list[Pair]:
    """A gait whose request is sent again, and answered again, when it is under way and over."""
    one, other = robot.ask(0, Gait.FORWARD), robot.ask(0, Gait.FORWARD)
    start = [robot.plant(PLANT_TRUTH, 0, 0, 0), one, robot.answer(0, Gait.FORWARD, ACCEPTED)]
    robot.now += 2000
    midway = [robot.plant(PLANT_TRUTH, 0.12, 0, 0), other, robot.answer(0, Gait.FORWARD, ACCEPTED)]
    robot.now += 1000
    end = [robot.plant(PLANT_TRUTH, 0.2, 0, 0), robot.answer(0, Gait.FORWARD, COMPLETED)]
    robot.now += 500
    sway = [robot.plant(PLANT_TRUTH, 0.21, 0, 0), robot.answer(0, Gait.FORWARD, COMPLETED)]
    return [*start, *midway, *end, *sway]


def test_a_request_that_is_sent_again_is_one_whole_gait() -> None:
    (run,) = summarise(resent(FakeRobot())).gait_runs
    assert run.forward == pytest.approx(0.2, abs=1e-9)
    assert run.duration == pytest.approx(3.0)
    (stride,) = read_timeline(resent(FakeRobot())).gaits
    assert (stride.start, stride.end) == (0, 2)


def test_a_refusal_that_is_said_again_is_one() -> None:
    robot = FakeRobot()
    refused = [robot.ask(0, Gait.FORWARD), robot.answer(0, Gait.FORWARD, GaitOutcome.REFUSED, "no")]
    (run,) = summarise([*refused, *refused]).gait_runs
    assert (run.outcome, run.refusals) == ("refused", 1)
    # A second copy may be refused when the first is under way.
    accepted = [robot.ask(1, Gait.FORWARD), robot.answer(1, Gait.FORWARD, ACCEPTED)]
    again = [robot.ask(1, Gait.FORWARD), robot.answer(1, Gait.FORWARD, GaitOutcome.REFUSED, "busy")]
    (run,) = summarise([*accepted, *again]).gait_runs
    assert (run.outcome, run.refusals) == ("accepted", 0)
