from lab.studies.latency.conditions import Condition
from lab.studies.latency.finding import find
from tests.lab.studies.latency.support import CONDITIONS, HAMMER, UNLOCK, plan_of, row, rows

PLAN = plan_of(*CONDITIONS, tasks=(UNLOCK,))
AS_PUBLISHED = {"raw": 8.0, "interpolation": 8.2, "latency-250": 9.0, "latency-500": 10.0}


def test_the_papers_shape_is_recognised() -> None:
    finding = find(PLAN, rows(AS_PUBLISHED))
    assert finding.reproduced is True
    assert [check.held for check in (*finding.latency, *finding.interpolation)] == [True] * 3
    assert "NOT" not in finding.sentence
    assert "synthetic" in finding.sentence


def test_time_that_does_not_rise_is_said() -> None:
    finding = find(PLAN, rows(AS_PUBLISHED | {"latency-500": 8.9}))
    assert finding.reproduced is False
    assert [check.held for check in finding.latency] == [True, False]
    assert "NOT reproduced" in finding.sentence
    assert "+500 ms against +250 ms: -0.10 s" in finding.sentence


def test_a_rise_within_the_noise_is_not_a_rise() -> None:
    noisy = [
        row("latency-250", seed, time)
        for seed, time in enumerate([6.0, 12.0, 7.0, 11.0, 6.5, 12.5])
    ]
    trials = [r for r in rows(AS_PUBLISHED) if r.condition != "latency-250"] + noisy
    finding = find(PLAN, trials)
    assert finding.latency[0].held is False
    assert finding.reproduced is False


def test_costly_interpolation_is_said() -> None:
    finding = find(PLAN, rows(AS_PUBLISHED | {"raw": 7.0}))
    assert finding.reproduced is False
    assert finding.interpolation[0].held is False
    assert "interpolation costs little" in finding.sentence


def test_trials_whose_simulation_failed_are_no_slow_raw_input() -> None:
    trials = rows(AS_PUBLISHED | {"interpolation": 9.0})
    assert find(PLAN, trials).interpolation[0].held is False
    errors = [row("raw", seed, 0.0, "error") for seed in range(20, 24)]
    assert find(PLAN, [*trials, *errors]).interpolation == find(PLAN, trials).interpolation


def test_trials_that_do_not_end_count_with_the_limit() -> None:
    trials = [r for r in rows(AS_PUBLISHED) if r.condition != "latency-500"]
    trials += [row("latency-500", seed, 4.0, "failure") for seed in range(6)]
    finding = find(PLAN, trials)
    assert finding.latency[1].held is True


def test_few_trials_prove_nothing() -> None:
    finding = find(PLAN, rows(AS_PUBLISHED, seeds=4))
    assert finding.reproduced is None
    assert "cannot be told" in finding.sentence
    assert find(plan_of(CONDITIONS[1]), rows({"interpolation": 8.0})).reproduced is None


def test_every_task_must_show_it_and_persons_do_not_count() -> None:
    plan = plan_of(*CONDITIONS, tasks=(UNLOCK, HAMMER))
    assert find(plan, rows(AS_PUBLISHED)).reproduced is None
    both = [*rows(AS_PUBLISHED), *rows(AS_PUBLISHED | {"latency-250": 8.1}, task=HAMMER)]
    assert find(plan, both).reproduced is False
    human = [r.model_copy(update={"operator": "human"}) for r in rows(AS_PUBLISHED)]
    assert find(PLAN, human).reproduced is None


def test_conditions_of_one_delay_are_each_compared_in_any_order() -> None:
    late = Condition(name="late", links={"command": "250ms"})
    blind = Condition(name="blind", links={"feedback": "250ms"})
    later = Condition(name="later", links={"command": "500ms"})
    trials = rows({"interpolation": 8.0, "late": 9.0, "blind": 7.0, "later": 10.0})
    for order in ((late, blind, later), (later, blind, late)):
        plan = plan_of(CONDITIONS[1], *order, tasks=(UNLOCK,))
        finding = find(plan, trials)
        assert finding.reproduced is False
        assert sorted(check.text for check in finding.latency if check.held) == sorted(
            f"{pair}: {said}"
            for pair, said in (
                (f"{late.title} against {CONDITIONS[1].title}", "+1.00 s [+1.00, +1.00]"),
                (f"{later.title} against {late.title}", "+1.00 s [+1.00, +1.00]"),
                (f"{later.title} against {blind.title}", "+3.00 s [+3.00, +3.00]"),
            )
        )
        assert [check.text.partition(":")[0] for check in finding.latency if not check.held] == [
            f"{blind.title} against {CONDITIONS[1].title}"
        ]
