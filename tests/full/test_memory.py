"""Memory of worlds: as estimated, and refused before it is allocated if it does not fit; it does not grow over time."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import warp as wp
from meshes import cube, quad_sphere

from balloon_warp import Balloon, Ground, InputError, Scene, Simulator, Sphere, String, Water
from balloon_warp.benchmarks.long_run import CASES, QUICK, Growth, measure
from balloon_warp.model import Model, build_model, state, world_bytes
from balloon_warp.schedules import SCHEDULES
from balloon_warp.schedules.choose import schedule_named

FEW, MANY = 16, 48
"""worlds; eight divide both, so that lanes has none to fill up"""


def scene() -> Scene:
    """Return a scene with a thing of each kind."""
    spheres = [Sphere(position=(x, 3.0, 0.0)) for x in (0.0, 1.0)]
    things = {"sphere": spheres, "string": [String(anchor=(0.0, -2.0, 0.0))], "ground": Ground(height=-3.0)}
    balloons = [Balloon(mesh=quad_sphere(4)), Balloon(mesh=cube(), position=(3.0, 0.0, 0.0))]
    return Scene(balloon=balloons, faces=False, touch=False, **things)


def arrays_in(thing: Any, seen: frozenset[int] = frozenset()) -> dict[int, wp.array]:
    """Return every reachable device array by its address, without visiting an object twice."""
    if id(thing) in seen:
        return {}
    seen |= {id(thing)}
    if isinstance(thing, wp.array):
        return {thing.ptr: thing} if thing.ptr else {}
    if isinstance(thing, list | tuple):
        parts = thing
    elif isinstance(thing, dict):
        parts = thing.values()
    elif hasattr(thing, "_cls"):  # an instance of a Warp struct
        parts = [getattr(thing, name) for name in thing._cls.vars]
    elif type(thing).__module__.startswith("balloon_warp") and not isinstance(thing, Model):
        parts = vars(thing).values()
    else:
        return {}
    return {address: array for part in parts for address, array in arrays_in(part, seen).items()}


def bytes_taken(simulator: Simulator) -> int:
    return sum(array.capacity for array in arrays_in(simulator).values())


@pytest.mark.parametrize("water", [None, Water(level=-9.0)])
@pytest.mark.parametrize("schedule", SCHEDULES)
def test_the_estimate_is_what_is_allocated(schedule: str, water: Water | None, device: str):
    if schedule in ("lanes", "octets") and device != "cpu":
        pytest.skip(f"{schedule} is for the CPU")
    if schedule == "octets" and water:
        pytest.skip("octets has no water")
    wet = scene().model_copy(update={"water": water})
    few, many = (Simulator(wet, device, worlds, schedule=schedule) for worlds in (FEW, MANY))
    taken = (bytes_taken(many) - bytes_taken(few)) / (MANY - FEW)
    estimate = world_bytes(many.model) + schedule_named(schedule, many.model).world_bytes(many.model)
    assert estimate == pytest.approx(taken, rel=0.005)


def test_lanes_counts_the_worlds_that_fill_up_the_last_eight():
    one, nine = (build_model(scene(), "cpu", worlds) for worlds in (1, 9))
    kept = schedule_named("lanes", one).world_bytes
    assert kept(one) == 8 * kept(build_model(scene(), "cpu", 8))
    assert 9 * kept(nine) == pytest.approx(2 * kept(one), rel=1e-3)  # rounded to whole bytes


def test_worlds_that_do_not_fit_are_refused_with_the_number_that_would(monkeypatch):
    model = build_model(scene(), "cpu")
    world = world_bytes(model) + schedule_named("scatter", model).world_bytes(model)
    monkeypatch.setattr(state, "free_memory", lambda device: int(10.5 * world / state.USABLE))
    assert len(Simulator(scene(), "cpu", 10, schedule="scatter").state.points) == 10
    with pytest.raises(
        InputError, match=r"^64 worlds do not fit: they need .* GiB, and cpu has .* enough for 10 worlds$"
    ):
        Simulator(scene(), "cpu", 64, schedule="scatter")


def test_a_schedule_that_keeps_less_lets_more_worlds_in(monkeypatch):
    model = build_model(scene(), "cpu", 64)
    kept = {name: schedule_named(name, model).world_bytes(model) for name in SCHEDULES}
    assert kept["block"] < kept["scatter"] < kept["lanes"]
    needed = 64 * (world_bytes(model) + np.mean([kept["block"], kept["scatter"]]))
    monkeypatch.setattr(state, "free_memory", lambda device: int(needed / state.USABLE))
    Simulator.of_model(model, "block")
    with pytest.raises(InputError, match=r"^64 worlds do not fit"):
        Simulator.of_model(model, "scatter")


BATCH = QUICK[-1]


@pytest.mark.parametrize("case", QUICK, ids=lambda case: case.name)
def test_memory_does_not_grow(case):
    growth = measure(case)
    assert growth.marks[-1][0] == case.frames
    assert growth.is_bounded, f"{growth.slope:.2f} MiB in {case.units}"


def test_frames_that_are_kept_are_seen():
    growth = measure(replace(BATCH, save_bytes=1 << 40))
    assert not growth.is_bounded
    assert growth.slope == pytest.approx(3.5, abs=1.0)  # 36 bytes of each of 1,016 particles


@pytest.mark.parametrize(("per_thousand", "bounded"), [(0.0, True), (0.7, True), (1.5, False), (20.0, False)])
def test_a_slope_is_found_beside_the_rise_and_fall_of_what_is_saved(per_thousand: float, bounded: bool):
    """A leak of more than 1 MiB in 1,000 frames is found beside 64 MiB that rise and fall each 2,700 frames."""
    frames = range(0, 10_001, 50)
    marks = [(frame, 90.0 + frame % 2700 / 2700 * 64.0 + per_thousand * frame / 1000) for frame in frames]
    growth = Growth(CASES[1], marks, 0.0)
    # The highest marks are 2,700 frames apart, of stretches of 3,000.
    assert growth.slope == pytest.approx(per_thousand, rel=0.15, abs=0.01)
    assert growth.is_bounded is bounded
