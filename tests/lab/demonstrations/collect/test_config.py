"""The settings say under which links episodes are made: those given, the task's own, or none."""

import argparse

import pytest

from common.errors import TrillError
from lab.cli.collect import _config, add_arguments
from lab.demonstrations.collect.config import EpisodeConfig, origin_of
from lab.trials.links import links_used
from tests.lab.demonstrations.collect.support import CONFIG, meta

PAPER = {"command": "paper"}


def asked(*options: str) -> EpisodeConfig:
    parser = argparse.ArgumentParser()
    add_arguments(parser)
    return _config(parser.parse_args(["hardware/cap", *options]))


@pytest.mark.parametrize(
    ("options", "links"),
    [
        ((), PAPER),
        (("--link", "none"), {}),
        (("--link", "both=250ms"), {"both": "250ms"}),
    ],
)
def test_what_is_recorded_is_what_the_trial_runs_under(
    options: tuple[str, ...], links: dict[str, str]
) -> None:
    config = asked(*options)
    assert config.links == links
    assert links_used(config.task, config.trial(0).links) == links
    # What a file says holds, whatever the task's own link should become.
    assert EpisodeConfig.model_validate_json(config.model_dump_json()).links == links


def test_without_a_word_about_links_the_own_one_is_put_in() -> None:
    assert EpisodeConfig(task="hardware/cap").links == PAPER
    assert EpisodeConfig.checked({"task": "hardware/cap", "links": None}).links == PAPER
    assert EpisodeConfig(task="hardware/cap", links={}).links == {}
    assert EpisodeConfig(task="door/unlock").links == {}
    with pytest.raises(TrillError, match="unknown task 'hardware/cup'"):
        EpisodeConfig.checked({"task": "hardware/cup"})


def test_an_origin_from_when_there_was_one_operator_is_the_same() -> None:
    new = CONFIG.origin()
    old = {name: value for name, value in new.items() if name != "operator"}
    old["traits"] = new["operator"]["traits"]
    before = meta(3).model_copy(update={"origin": old})
    assert origin_of(before) == new
    assert origin_of(before.model_copy(update={"origin": {"recorded": 1}})) == {"recorded": 1}
