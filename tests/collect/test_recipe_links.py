"""A recipe says which links its episodes are really made under: given, the task's own, or none."""

import argparse

import pytest

from common.errors import TrillError
from deploy.cli.collect import _recipe, add_arguments
from studies.collect.recipe import Recipe
from studies.tasks.links import links_used

PAPER = {"command": "paper"}


def asked(*options: str) -> Recipe:
    parser = argparse.ArgumentParser()
    add_arguments(parser)
    return _recipe(parser.parse_args(["twin/cap", *options]))


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
    recipe = asked(*options)
    assert recipe.links == links
    assert links_used(recipe.task, recipe.trial(0).links) == links
    # What a file says holds, whatever the task's own link should become.
    assert Recipe.model_validate_json(recipe.model_dump_json()).links == links


def test_without_a_word_about_links_the_own_one_is_put_in() -> None:
    assert Recipe(task="twin/cap").links == PAPER
    assert Recipe.checked({"task": "twin/cap", "links": None}).links == PAPER
    assert Recipe(task="twin/cap", links={}).links == {}
    assert Recipe(task="door/unlock").links == {}
    with pytest.raises(TrillError, match="unknown task 'twin/cup'"):
        Recipe.checked({"task": "twin/cup"})
