"""Exams: rendered scenes of a fixed seed, by name."""

from functools import partial

import torch

from photonormal.train import validate
from photonormal.train.card import TITLES
from photonormal.train.recipes import RECIPES, Recipe


def test_every_recipes_exams_exist_and_every_exam_has_a_heading():
    assert {kind for made in RECIPES.values() for kind in made.exams} <= set(validate.EXAMS) <= set(TITLES)


def test_a_recipe_is_examined_by_its_own_exams(monkeypatch):
    """Rendered with what each exam changes, in the recipe's windows, from one seed."""
    monkeypatch.setattr(validate, "BATCHES", 1)
    asked = []

    def stream(*given, **options):
        asked.append((given, options))
        yield "batch"

    recipe = Recipe(exams=("dark", "hollow-metal"), rendering={"crop": 64, "scenes": 3}, batch=5)
    exams = validate.examined(partial(stream), torch.device("cpu"), recipe)
    assert exams == {"dark": ["batch"], "hollow-metal": ["batch"]}
    assert all(given[1] == 5 and given[3] == validate.SEED and options["crop"] == 64 for given, options in asked)
    assert asked[0][1]["dark"] == 1.0 and asked[1][1]["metal"] is True


def test_few_minutes_of_learning_are_examined_by_fewer_windows(monkeypatch):
    """The first of those that others have, as a whole exam takes longer than they do."""
    monkeypatch.setattr(validate, "BATCHES", 8)

    def stream(*given, **options):
        yield from range(100)

    def windows(minutes):
        return validate.examined(stream, torch.device("cpu"), Recipe(exams=("dark",)), minutes)["dark"]

    assert [len(windows(minutes)) for minutes in (0.1, 0.5, 1.2, 4, 60, None)] == [1, 1, 3, 8, 8, 8]
    assert windows(1.2) == windows(None)[:3]
