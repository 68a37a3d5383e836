"""Rows of an evaluation, from invented trials."""

import pytest
from rich.console import Console

from lab.learning.evaluation.names import policy_name
from lab.learning.evaluation.summary import success_times, summarise
from lab.learning.evaluation.text import rows_text
from lab.trials.operators.specs import SyntheticSpec
from lab.trials.spec import FALL, TrialSpec
from services.policy.kinds import CONFIGS
from services.sim.tasks import find_task
from services.sim.tasks.judge import Judge
from tests.lab.learning.evaluation.support import UNLOCK, invented, result, trial
from tests.services.sim.tasks.support import snapshot

POLICY = invented("mine")
CHUNKS = {"kind": "chunks"}
SETPOINT = {"previous_setpoint": True}
TRIALS = [
    (trial(POLICY, 0), result(0, time=7.0, still=1.0)),
    (trial(POLICY, 1), result(1, time=9.0, still=2.0)),
    (trial(POLICY, 2), result(2, "partial", still=3.0)),
    (trial(POLICY, 3), result(3, "failure", reason=FALL)),
]


def test_a_row_counts_as_the_paper_does() -> None:
    (row,) = summarise(TRIALS, {})
    assert (row.label, row.task, row.link, row.episodes) == ("mine", UNLOCK, "none", 3)
    assert (row.success.share, row.partial.share, row.falls) == (0.5, 0.75, 1)
    # Wilson's interval of 2 of 4.
    assert (row.success.low, row.success.high) == pytest.approx((0.150, 0.850), abs=1e-3)
    assert (row.times, row.still) == ([7.0, 9.0], 2.0)


def test_times_are_compared_where_both_succeed() -> None:
    def operated(seed: int) -> TrialSpec:
        return TrialSpec(task=UNLOCK, seed=seed, operator=SyntheticSpec())

    operator = success_times(
        [(operated(seed), result(seed, time=5.0)) for seed in (0, 2, 3, 7)]
        + [(operated(1), result(1, "failure"))]
    )
    (row,) = summarise(TRIALS, operator)
    assert (row.difference.mean, row.difference.count) == (2.0, 1)


def test_policies_data_sets_and_links_have_rows_of_their_own() -> None:
    late = result(0, links={"command": "250ms"})
    rows = summarise([*TRIALS, (trial(POLICY, 0), late), (trial(invented("mine", 9)), late)], {})
    assert [(row.link, row.episodes, len(row.results)) for row in rows] == [
        ("none", 3, 4),
        ("command=250ms", 3, 1),
        ("command=250ms", 9, 1),
    ]


def test_the_table_names_every_trial_that_failed() -> None:
    console = Console(width=200)
    with console.capture() as capture:
        console.print(rows_text(summarise(TRIALS, {})))
    text = capture.get()
    assert "50 [15, 85]" in text
    assert "8.0 (7.0 to 9.0)" in text
    assert f"mine: {UNLOCK} seed 3: failure at 8.0 s: {FALL}" in text
    assert "seed 1" not in text
    assert "Δ" not in text


def test_the_judge_says_a_fall_as_results_expect() -> None:
    judge = Judge(find_task(UNLOCK))
    joints = dict.fromkeys(("door_lever", "door_hinge"), 0.0)
    judge.tick(snapshot(1.0, fallen=True, joints=joints))
    assert judge.reason == FALL


@pytest.mark.parametrize(
    ("kind", "changes", "name"),
    [
        ("trill", {}, "trill"),
        ("trill", {"inputs": {"vision": "monoscopic"}}, "trill, monoscopic"),
        ("trill", {"inputs": {"joint_state": False}}, "trill, no-joint-state"),
        ("trill", {"deterministic": True}, "trill, deterministic"),
        ("trill", {"categorical": True}, "trill, categorical"),
        ("bc", {}, "bc"),
        (
            "bc-rnn",
            {"inputs": {"vision": "blind", "scene": ("x",)}, "actions": CHUNKS},
            "bc-rnn, oracle, chunks",
        ),
        (
            "trill",
            {"inputs": {"joint_state": False, "estimated": ("x",)}, "actions": CHUNKS},
            "trill, estimated scene, chunks",
        ),
        (
            "trill",
            {"inputs": {"joint_state": False, "body_poses": False, **SETPOINT}, "actions": CHUNKS},
            "trill, no-joint-state, chunks",
        ),
    ],
)
def test_a_policy_is_called_by_what_sets_it_apart(
    kind: str, changes: dict[str, object], name: str
) -> None:
    config = CONFIGS[kind].model_validate(changes)
    assert str(policy_name(config.model_dump(mode="json"))) == name
