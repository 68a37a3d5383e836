from lab.studies.latency.conditions import Condition
from lab.studies.latency.criteria import compare, reproduced
from tests.lab.studies.latency.support import CONDITIONS, HAMMER, UNLOCK, plan_of, trial, trials

PLAN = plan_of(*CONDITIONS, tasks=(UNLOCK,))
AS_PUBLISHED = {"raw": 8.0, "interpolation": 8.2, "latency-250": 9.0, "latency-500": 10.0}


def met(times: dict[str, float], seeds: int = 6) -> list[bool | None]:
    """Whether +250 ms, +500 ms and interpolation meet their criteria."""
    return [comparison.met for comparison in compare(PLAN, trials(times, seeds))]


def test_the_papers_shape_is_recognised() -> None:
    comparisons = compare(PLAN, trials(AS_PUBLISHED))
    assert reproduced(comparisons) is True
    assert [(c.criterion, c.condition, c.reference, c.met) for c in comparisons] == [
        ("latency", "latency-250", "interpolation", True),
        ("latency", "latency-500", "latency-250", True),
        ("interpolation", "interpolation", "raw", True),
    ]
    assert [round(c.difference.mean or 0.0, 6) for c in comparisons] == [0.8, 1.0, 0.2]
    # Raw input takes 8.0 to 8.5 s; interpolation may cost a tenth of it.
    assert [round(c.bound, 6) for c in comparisons] == [0.0, 0.0, 0.825]


def test_time_that_does_not_rise_fails_the_criterion() -> None:
    comparisons = compare(PLAN, trials(AS_PUBLISHED | {"latency-500": 8.9}))
    assert reproduced(comparisons) is False
    assert [c.met for c in comparisons] == [True, False, True]
    assert comparisons[1].difference.text("+.2f") == "-0.10 [-0.10, -0.10]"


def test_a_rise_within_the_noise_is_not_a_rise() -> None:
    noisy = [
        trial("latency-250", seed, time)
        for seed, time in enumerate([6.0, 12.0, 7.0, 11.0, 6.5, 12.5])
    ]
    others = [t for t in trials(AS_PUBLISHED) if t.condition != "latency-250"]
    comparisons = compare(PLAN, others + noisy)
    assert comparisons[0].met is False
    assert reproduced(comparisons) is False


def test_costly_interpolation_fails_the_criterion() -> None:
    assert met(AS_PUBLISHED | {"raw": 7.0}) == [True, True, False]


def test_trials_whose_simulation_failed_are_no_slow_raw_input() -> None:
    usual = trials(AS_PUBLISHED | {"interpolation": 9.0})
    assert compare(PLAN, usual)[2].met is False
    errors = [trial("raw", seed, 0.0, "error") for seed in range(20, 24)]
    assert compare(PLAN, [*usual, *errors]) == compare(PLAN, usual)


def test_trials_that_do_not_end_count_with_the_limit() -> None:
    usual = [t for t in trials(AS_PUBLISHED) if t.condition != "latency-500"]
    failures = [trial("latency-500", seed, 4.0, "failure") for seed in range(6)]
    assert compare(PLAN, usual + failures)[1].met is True


def test_few_trials_decide_nothing() -> None:
    assert met(AS_PUBLISHED, seeds=4) == [None] * 3
    assert reproduced(compare(PLAN, trials(AS_PUBLISHED, seeds=4))) is None
    assert reproduced(compare(plan_of(CONDITIONS[1]), trials({"interpolation": 8.0}))) is None


def test_every_task_must_show_it_and_persons_do_not_count() -> None:
    plan = plan_of(*CONDITIONS, tasks=(UNLOCK, HAMMER))
    assert reproduced(compare(plan, trials(AS_PUBLISHED))) is None
    both = [*trials(AS_PUBLISHED), *trials(AS_PUBLISHED | {"latency-250": 8.1}, task=HAMMER)]
    assert reproduced(compare(plan, both)) is False
    human = [t.model_copy(update={"operator": "human"}) for t in trials(AS_PUBLISHED)]
    assert reproduced(compare(PLAN, human)) is None


def test_conditions_of_one_delay_are_each_compared_in_any_order() -> None:
    late = Condition(name="late", links={"command": "250ms"})
    blind = Condition(name="blind", links={"feedback": "250ms"})
    later = Condition(name="later", links={"command": "500ms"})
    times = {"interpolation": 8.0, "late": 9.0, "blind": 7.0, "later": 10.0}
    for order in ((late, blind, later), (later, blind, late)):
        plan = plan_of(CONDITIONS[1], *order, tasks=(UNLOCK,))
        comparisons = compare(plan, trials(times))
        assert reproduced(comparisons) is False
        assert {
            (c.condition, c.reference): (c.difference.text("+.2f"), c.met) for c in comparisons
        } == {
            ("late", "interpolation"): ("+1.00 [+1.00, +1.00]", True),
            ("blind", "interpolation"): ("-1.00 [-1.00, -1.00]", False),
            ("later", "late"): ("+1.00 [+1.00, +1.00]", True),
            ("later", "blind"): ("+3.00 [+3.00, +3.00]", True),
        }
