"""Fuzzer of physics: faults that it found stay mended, fixed scenes hold to all properties, and each can fail."""

import itertools
from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from costs import nightly_but

from balloon_warp.benchmarks import physics_alike, physics_fuzz
from balloon_warp.benchmarks.physics_alike import Measure, Property, converges, slopes_are_differences
from balloon_warp.benchmarks.physics_fuzz import PropertyError, check, fuzz, read_scene, scene_file
from balloon_warp.benchmarks.physics_known import KNOWN
from balloon_warp.benchmarks.physics_properties import PROPERTIES, tells_contact_forces
from balloon_warp.benchmarks.physics_runs import Case, Run, simulated
from balloon_warp.benchmarks.physics_scenes import KINDS, drawn
from balloon_warp.benchmarks.physics_twins import Tables
from balloon_warp.lab.gradients import gradient as gradients
from balloon_warp.scene import load_scene

FOUND = sorted((Path(__file__).parent / "found").glob("*.toml"))
SCENES = 3
"""Scenes of each kind: a minute in all by default, once their kernels are compiled"""
SEEDS = {"film": 2}
"""Seeds by kind: none of these films blows up, whose report takes kernels"""
OF_THEIR_OWN_KERNELS = (
    tells_contact_forces, slopes_are_differences, physics_alike.is_alike_among_worlds,
    physics_alike.is_alike_in_schedules,
)  # fmt: skip
"""Properties that compile more kernels than a default test should; test_reference.py has all schedules"""


@pytest.fixture
def cheap(monkeypatch: pytest.MonkeyPatch) -> None:
    """Leave out properties that compile kernels of their own."""
    kept = tuple(each for each in PROPERTIES if each not in OF_THEIR_OWN_KERNELS)
    monkeypatch.setattr(physics_fuzz, "PROPERTIES", kept)


@pytest.mark.full
@pytest.mark.parametrize("path", FOUND, ids=lambda path: path.stem)
def test_what_was_found_stays_mended(path: Path):
    check(read_scene(path.read_text("utf-8")), PROPERTIES, "cpu", Counter())


@pytest.mark.full
@pytest.mark.parametrize(
    "path", sorted((Path(__file__).parent / "found" / "known").glob("*.toml")), ids=lambda path: path.stem
)
def test_what_is_known_is_not_mended_yet(path: Path):
    """Move a scene that passes here to tests/found/, and remove its lines in LIMITS.md and `physics_known`."""
    counts: Counter[str] = Counter()
    check(read_scene(path.read_text("utf-8")), PROPERTIES, "cpu", counts)
    assert any(name.startswith("known: ") for name in counts)


def test_limits_has_what_is_known():
    limits = (Path(__file__).parent.parent / "docs" / "LIMITS.md").read_text("utf-8")
    for each in KNOWN:
        assert f"- **{each.line}**" in limits


USUAL = ("bodies", "bursting", "film", "obstacles", "touch", "water")
"""the kinds of scenes that have shown most faults"""


@pytest.mark.usefixtures("cheap")
@pytest.mark.parametrize(
    "name",
    [
        *("springs", "gas", *USUAL),
        *(pytest.param(name, marks=pytest.mark.full) for name in ("rubber", "spheres", "pressed", "strings", "paper")),
        *(pytest.param(name, marks=mark) for name, mark in (("tubes", pytest.mark.full), ("all", pytest.mark.nightly))),
    ],
)
def test_fixed_scenes_hold_to_the_properties(name: str):
    counts: Counter[str] = Counter()
    fuzz(KINDS[name], SCENES, SEEDS.get(name, 0), counts)
    assert counts["properties"] >= 5 * counts["simulated"] > 0


@pytest.mark.full
@pytest.mark.parametrize("name", nightly_but(USUAL, KINDS))
def test_more_scenes_hold_to_all_properties(name: str):
    fuzz(KINDS[name], SCENES, 1, Counter())


@cache
def one_of(name: str) -> Tables:
    """Return a lively scene of a kind, four frames long: of five, that with the fewest substeps."""
    scenes: list[Tables] = []

    def keep(tables: Tables) -> None:
        scenes.append({**tables, "frames": 4})

    drawn(KINDS[name], 10, 3, keep)
    return min(scenes[-5:], key=lambda tables: Case(tables).substeps)


def spoiled(run: Run, **states: Callable[[Any], Any]) -> Run:
    """Return a run whose last frame has other states."""
    changed = {name: values.copy() for name, values in run.states.items()}
    for name, change in states.items():
        changed[name][-1] = change(changed[name][-1])
    return replace(run, states=changed)


WRONG: dict[str, tuple[str, dict[str, Callable[[Any], Any]]]] = {
    "stays_finite": ("springs", {"points": lambda x: x * np.nan}),
    "keeps_volume": ("gas", {"points": lambda x: -x}),
    "gains_no_energy": ("springs", {"velocities": lambda v: 3.0 * v + v.max()}),
    "keeps_momentum": ("springs", {"velocities": lambda v: 1.01 * v + 0.01 * np.abs(v).max()}),
    "keeps_angular_momentum": ("springs", {"velocities": lambda v: v * (1.0, 1.01, 0.99) + np.roll(v, 1, axis=0)}),
    "keeps_gas": ("gas", {"gas_amounts": lambda n: 1.001 * n}),
    "follows_boyle": ("gas", {"pressures": lambda p: p + 1013.0}),
    "stays_outside": ("bodies", {"points": lambda x: x - (0.0, 2.0 * np.abs(x).max(), 0.0)}),
    "tells_contact_forces": ("spheres", {"contact_forces": lambda f: f + 1.0e9}),
}
"""Kinds of scenes in which properties of one run are checked, and changes of states that break them"""


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=pytest.mark.full if name in {each.__name__ for each in OF_THEIR_OWN_KERNELS} else ())
        for name in WRONG
    ],
)
def test_a_wrong_state_is_found(name: str):
    kind, states = WRONG[name]
    holds = next(each for each in PROPERTIES if each.__name__ == name)
    right, wrong = (
        holds(Case(one_of(kind), "cpu", lambda *asked, change=change: spoiled(simulated(*asked), **change)))
        for change in ({}, states)
    )
    assert right
    assert right.holds
    assert wrong
    assert not wrong.holds


@pytest.mark.usefixtures("cheap")
@pytest.mark.parametrize(
    "holds",
    [
        pytest.param(each, marks=pytest.mark.full if each in OF_THEIR_OWN_KERNELS else (), id=each.__name__)
        for each in PROPERTIES
        if each.__name__ not in WRONG
    ],
)
def test_a_wrong_motion_is_found(holds: Property, monkeypatch: pytest.MonkeyPatch):
    """Runs have a particle ever farther off, of three the last alone; the reference rests; a slope is doubled."""
    case, of_cases = Case(one_of("springs")), gradients.gradient
    numbers = itertools.count(-1 if holds is converges else 1)
    assert case.is_calm
    measure = holds(case)
    assert measure
    assert measure.holds

    def off(*asked: Any) -> Run:
        run, shift = simulated(*asked), 3.0e-3 * case.size * max(next(numbers), 0)
        points = run.states["points"].copy()
        points[1:, 0] += shift
        return replace(run, states={**run.states, "points": points})

    def steep(*asked: Any, **more: Any) -> Any:
        found = of_cases(*asked, **more)
        return replace(found, gradients={path: 2.0 * slope for path, slope in found.gradients.items()})

    again = Case(case.tables, "cpu", off)
    again.run, again.spread = case.run, case.spread
    monkeypatch.setattr("balloon_warp.lab.reference.Reference.frame", lambda reference: None)
    if holds is slopes_are_differences:
        monkeypatch.undo()
        monkeypatch.setattr("balloon_warp.benchmarks.physics_alike.gradient", steep)
    measure = holds(again)
    assert measure
    assert not measure.holds


def test_a_failure_is_shrunk_and_written_as_a_scene(monkeypatch: pytest.MonkeyPatch, tmp_path: Path):
    """A property that forbids gravity fails first in some scene; the smallest one has nothing else of note.

    No scene is simulated, for the property looks at its tables alone."""

    def has_no_gravity(case: Case) -> Any:
        return Measure(case.scene.gravity, 0.0, "gravity")

    monkeypatch.setattr(physics_fuzz, "PROPERTIES", (has_no_gravity,))
    still = Run(SimpleNamespace(substeps=1), {}, None)
    monkeypatch.setattr("balloon_warp.benchmarks.physics_runs.simulated", lambda *asked: still)
    with pytest.raises(PropertyError, match=r"has_no_gravity: found 0\.3, allowed 0 \(gravity\)") as found:
        fuzz(KINDS["gas"], 20, 0, Counter())
    path = tmp_path / "found.toml"
    path.write_text(scene_file(found.value.tables), encoding="utf-8")
    assert read_scene(path.read_text("utf-8")).keys() <= found.value.tables.keys()
    scene = load_scene(path)
    assert scene.frames == 2
    assert scene.gravity == pytest.approx(0.3)
    assert scene.balloon[0].velocity == (0.0, 0.0, 0.0)


def test_the_command_ends_with_a_failure_and_its_scene(monkeypatch: pytest.MonkeyPatch, capsys: Any):
    def never(case: Case) -> Any:
        return Measure(2.0, 1.0, "planted")

    monkeypatch.setattr(physics_fuzz, "PROPERTIES", (never,))
    with pytest.raises(SystemExit) as ended:
        physics_fuzz.main(["--seconds", "5", "--seed", "1", "--device", "cpu"])
    assert ended.value.code == 1
    printed = capsys.readouterr().out
    assert "never: found 2, allowed 1 (planted)" in printed
    assert "[[balloon]]" in printed


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["--seconds", "0"], "--seconds: must be a number of seconds from 1 on (got 0)"),
        (["--device", "abacus"], "device abacus: no such device"),
    ],
)
def test_bad_input_is_one_sentence(arguments: list[str], sentence: str, capsys: Any):
    with pytest.raises(SystemExit) as ended:
        physics_fuzz.main(arguments)
    assert ended.value.code == 2
    assert sentence in capsys.readouterr().err
