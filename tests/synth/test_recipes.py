"""Recipes refuse what they don't know."""

import pytest

from photonormal.synth.recipes import RECIPES, check, recipe
from photonormal.types import InputError


def test_all_named_recipes_make_sense():
    for made in RECIPES.values():
        check(made)


def test_a_field_is_changed_in_a_copy():
    assert recipe("train", crop=64).crop == 64
    assert RECIPES["train"].crop == 32


@pytest.mark.parametrize(
    ("name", "changes", "message"),
    [
        ("trian", {}, "no recipe 'trian'; perhaps train is meant; choose from train, validation"),
        ("train", {"ligths": (3, 4)}, "a recipe has no 'ligths'; it has size, crop"),
        ("train", {"lights": (40, 8)}, "1 <= fewest <= most <= 300"),
        ("train", {"lights": (1, 301)}, "1 <= fewest <= most <= 300"),
        ("train", {"size": 100}, "divisible by 8"),
        ("train", {"crop": 256}, "crop <= size"),
        ("train", {"crops": 0}, "at least 1 each"),
        ("train", {"shapes": (1.0, -1.0, 0.0, 0.0, 0.0, 0.0, 1.0)}, "shares can't be negative"),
        ("train", {"dark": 1.2}, "dark is 1.2 but a share from 0 to 1 is needed"),
        ("train", {"jpeg": -0.1}, "jpeg is -0.1 but a share from 0 to 1 is needed"),
        ("train", {"zoom": 2.0}, "zoom is 2.0 but a share from 0 to 1 is needed"),
        ("train", {"noise": -0.1}, "noise is -0.1 but 0 or more is needed"),
        ("train", {"distance": -3.0}, "distance is -3.0 but half widths above 0 are needed"),
        ("train", {"solid": "buste"}, "solid is 'buste' but drawn or bust is needed"),
        ("train", {"materials": (0.0,) * 6}, "8 and 6, not all zero, are needed"),
    ],
)
def test_nonsense_is_refused(name, changes, message):
    with pytest.raises(InputError, match=message):
        recipe(name, **changes)
