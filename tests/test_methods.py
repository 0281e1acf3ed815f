"""Table of methods: every line of it runs, and the page has them all."""

import re
from pathlib import Path

import pytest

from balloon_warp import InputError, load_scene
from balloon_warp.benchmarks.methods import METHODS, PAPER, SCENE, Method, as_markdown, measure_methods
from balloon_warp.model import build_model
from balloon_warp.scene.overrides import parse_override
from balloon_warp.schedules.choose import schedule_named

PAGE = (Path(__file__).parent.parent / "docs" / "METHODS.md").read_text(encoding="utf-8")


@pytest.mark.full
def test_methods_are_measured():
    """Methods are measured: one of each solver, and one schedule by name; test_matrix.py runs all their features."""
    some = [method for method in METHODS if method.name in ("the paper's step", "projective", "schedule `scatter`")]
    rows = measure_methods(some, device="cpu", rounds=1, frames=2)
    assert [row.method for row in rows] == some
    assert rows[0].ratio == 1.0
    assert all(row.ratio is not None and row.ratio > 0.0 for row in rows)
    assert len(as_markdown(rows).splitlines()) == 2 + len(some) == 5


@pytest.mark.full
@pytest.mark.parametrize("method", METHODS, ids=lambda method: method.name)
def test_every_method_can_be_measured(method: Method):
    overrides = [parse_override(text) for text in (*PAPER, *method.overrides)]
    model = build_model(load_scene(SCENE, overrides), "cpu")
    schedule_named(method.schedule, model)


def test_the_page_has_a_line_for_every_method_with_the_values_that_were_measured():
    """The overrides repeat a line; of a long table the beginning stands there."""
    for method in METHODS:
        [line] = re.findall(rf"^\| {re.escape(method.name)} \|.*", PAGE, re.M)
        assert [value for value in method.overrides if value.split(",")[0] not in line] == [], method.name


@pytest.mark.full
def test_a_method_that_blows_up_is_said_to_and_one_that_is_refused_is_a_mistake():
    rows = measure_methods([Method("first"), Method("wild", ("balloon.inflation.k_normal=9e11",))], "cpu", 1, 3)
    assert as_markdown(rows).splitlines()[-1].startswith("| wild | blows up |")
    with pytest.raises(InputError, match=r"wrong: balloon\.0\.mass: must be greater than 0"):
        measure_methods([Method("first"), Method("wrong", ("balloon.mass=-1",))], "cpu", 1, 1)
