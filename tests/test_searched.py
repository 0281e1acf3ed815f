"""Schedule `block` of balloons that touch themselves: worlds go on in blocks while a search has listed nothing."""

from dataclasses import replace
from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from conserved import cushion
from meshes import joined, quad_sphere

from balloon_warp import InputError, Simulator, load_scene
from balloon_warp.kernels.contact.free_frames import BUSY, FREE
from balloon_warp.model import build_model
from balloon_warp.scene import Balloon, Body, Ground, Inflation, Material, Obstacle, Scene, Sphere, Touch
from balloon_warp.schedules import frames
from balloon_warp.schedules.choose import fastest_schedule, schedule_named
from balloon_warp.schedules.frames import TURN
from balloon_warp.schedules.gather import GatherSchedule
from balloon_warp.schedules.one_launch import BlockSchedule, SearchedSchedule
from balloon_warp.schedules.tables import model_features
from balloon_warp.schedules.touch_table import substeps_of_search
from balloon_warp.tools.foil import foil_mesh

BALL, GAP = quad_sphere(2, 0.5), 0.25
PLACES = ((0.0, 0.0, 0.0), (0.0, 2.0 * (1.0 + GAP), 0.0), (0.01, 1.0 + GAP, 0.02))
"""Centers of three balls of one balloon: two that are fixed, and one between them, aside, so that no particle of it is
as near to several triangles [m]"""
BETWEEN = joined(*(replace(BALL, points=BALL.points + place) for place in PLACES))
RUBBER = Material(kind="neo_hookean", shear_modulus=4e6, thickness=5e-4, softening=0.5)
FILLED = {
    "pumped": Inflation(kind="gas", start_pressure=6000.0, pump=[(0.0, 0.5), (0.2, 2.0)]),
    "sealed": Inflation(kind="gas", start_pressure=6000.0),
    "under a pressure": Inflation(pressure=[(0.0, 1500.0), (0.2, 2000.0)]),
}
"""What the balls are filled with: gas that changes in each substep, or that is weighed as a round begins; and nothing,
where places alternate between two arrays"""
ODD, EVEN = 171, 174
"""Numbers of substeps of a frame: four rounds of 35, which are more than two turns, and 31 or 34 left over"""
FRAMES = 16
Course = list[dict[str, np.ndarray]]
"""State after each frame, by name"""
SPEEDS = (0.0, -9.0, 8.0, -4.0)
"""Speed of the ball in each world [m/s]: in the first nothing touches, in others it flies from ball to ball and back"""
WORLDS = (0, 1, 2, 3)
ROUNDINGS = {"points": 4e-6, "velocities": 2e-4, "pressures": 5e-4, "gas_amounts": 1e-9, "peak": 1e-5}
"""Rounding over the largest value: of places and speeds by sums in another order, of pressures by that of the air's,
which are a hundred times as large; amounts of gas are kept in float64, and rates in float32"""
MOVE, MOVES = 1e-6, 8
"""Offset of all places at the start [m], of 3 m, which shows how contact amplifies the rounding of float32: each of a
frame's 171 substeps rounds a place by 1e-7, which adds up as a random walk; and the number of times that each world
starts so, as it decides how a ball hits"""


def flying(filled: str, substeps: int) -> Scene:
    """Return three balls of rubber that softens; one flies between the others."""
    pinned = list(range(2 * BALL.vertex_count))
    balls = Balloon(mesh=BETWEEN, damping=0.05, fixed=pinned, material=RUBBER, inflation=FILLED[filled])
    touch = Touch(itself=True)
    return Scene(balloon=[balls], touch=touch, substeps=substeps, frames_per_second=60, gravity=5.0, frames=FRAMES)


@cache
def course(filled: str, schedule: str, device: str, worlds: tuple[int, ...] = WORLDS, moved: bool = False) -> Course:
    """Return the state after each frame, with the verdicts of its last search.

    Args:
        worlds: those of `SPEEDS`.
        moved: whether each starts from slightly other places.
    """
    vary = {"balloon.0.velocity.1": [SPEEDS[world] for world in worlds]}
    simulator = Simulator(flying(filled, ODD), device, len(worlds), vary, schedule=schedule)
    if moved:
        points = simulator.state.points.numpy()
        offsets = MOVE * np.random.default_rng(1).uniform(-1.0, 1.0, points.shape)
        simulator.state.points.assign((points + offsets).astype(np.float32))
    return [after_frame(simulator) for _ in range(FRAMES)]


def apart(some: np.ndarray, others: np.ndarray) -> np.ndarray:
    """Return root mean squares of differences in each world: one particle that touches a substep sooner says little."""
    return np.sqrt(np.square(some - others, dtype=float).reshape(len(some), -1).mean(axis=1))


def after_frame(simulator: Simulator) -> dict[str, np.ndarray]:
    simulator.step_unread()
    arrays = simulator.state.arrays | {"verdicts": simulator.schedule.launches.working.verdicts}
    return {name: array.numpy().copy() for name, array in arrays.items()}


@pytest.mark.full
@pytest.mark.parametrize("filled", FILLED)
def test_worlds_go_from_blocks_to_launches_and_back_as_in_launches_alone(filled: str, device: str):
    """Places, gas, and how far rubber has been stretched go along. Differences are those of rounding, and what contact
    makes of it: at most four times of what it has made so far of starts that are moved by MOVE."""
    found, expected = course(filled, "block", device), course(filled, "gather", device)
    verdicts = np.array([each["verdicts"] for each in found])
    assert (verdicts[:, 0] == FREE).all()
    for world in (1, 2):  # clear, busy, clear, busy, clear
        assert (np.flatnonzero(np.diff(verdicts[:, world])).size, verdicts[0, world]) == (4, FREE)
    moved = course(filled, "gather", device, WORLDS * MOVES, moved=True)
    assert (expected[-1]["peak"].max(axis=1)[1:3] > 1.02 * expected[-1]["peak"][0].max()).all(), (
        "contact stretches them"
    )
    spreads = {field: np.zeros(len(WORLDS)) for field in ROUNDINGS}
    for mine, launched, asides in zip(found, expected, moved, strict=True):
        for field, rounding in ROUNDINGS.items():
            spread = np.max([apart(launched[field], aside) for aside in np.split(asides[field], MOVES)], axis=0)
            spreads[field] = np.maximum(spreads[field], spread)
            most = 4.0 * spreads[field] + rounding * np.abs(launched[field]).reshape(len(WORLDS), -1).max(axis=1)
            assert (apart(launched[field], mine[field]) <= most).all(), field


@pytest.mark.full
@pytest.mark.parametrize("filled", FILLED)
@pytest.mark.parametrize("world", [0, 1, 3])
def test_a_world_does_not_feel_how_clear_another_is(world: int, filled: str, device: str):
    among, alone = course(filled, "block", device), course(filled, "block", device, worlds=(world,))
    for batch, one in zip(among, alone, strict=True):
        for field, values in one.items():
            if len(batch[field]) == len(SPEEDS):
                np.testing.assert_array_equal(batch[field][world], values[0], err_msg=field)


@pytest.mark.full
@pytest.mark.parametrize("filled", FILLED)
@pytest.mark.parametrize("substeps", [ODD, EVEN])
def test_a_frame_of_recorded_rounds_is_to_the_bit_one_of_single_substeps(
    substeps: int, filled: str, device: str, monkeypatch: pytest.MonkeyPatch
):
    """Rounds have an odd number of substeps, the last, shorter one an odd or an even number."""
    vary = {"balloon.0.velocity.1": SPEEDS}
    simulator = Simulator(flying(filled, substeps), device, 4, vary, schedule="block")
    interval = substeps_of_search(simulator.model)
    assert interval % 2 == 1
    assert interval >= 2 * TURN
    assert (substeps // interval, substeps % interval % 2) == (4, substeps % 2)
    in_rounds = [after_frame(simulator) for _ in range(4)]
    monkeypatch.setattr(frames, "FLAT", substeps)
    monkeypatch.setattr(frames, "FEW", FRAMES)
    single = Simulator(flying(filled, substeps), device, 4, vary, schedule="block")
    assert (simulator.schedule.rounds.are_short, single.schedule.rounds.are_short) == (True, False)
    for recorded in in_rounds:
        np.testing.assert_equal(recorded, after_frame(single))
    assert {FREE, BUSY} == set(in_rounds[-1]["verdicts"].tolist())


LIES = Balloon(mesh=cushion(2), inflation=Inflation(pressure=5.0))
PUSHED = Balloon(mesh=cushion(2), inflation=Inflation(k_normal=0.1))
BRITTLE = Balloon(mesh=BALL, material=Material(preset="latex", strength=2e6))
WALL = Obstacle(size=(1.0, 1.0, 1.0), position=(0.0, -3.0, 0.0))
CLEARS: dict[str, dict[str, Any]] = {
    "alone": {},
    "gas": {"balloon": [Balloon(mesh=BALL, inflation=Inflation(kind="gas"))]},
    "fresh normals": {"balloon": [PUSHED], "normals": "fresh"},
    "on the ground": {"ground": Ground(height=-3.0)},
    "above an obstacle": {"obstacle": [WALL], "faces": False},
}
"""Scenes of balloons that touch themselves, and of which a search tells all that may touch"""
DOES_NOT: dict[str, dict[str, Any]] = {
    "only others": {"balloon": [LIES, LIES.model_copy(update={"position": (3.0, 0.0, 0.0)})], "touch": Touch()},
    "nothing": {"touch": False},
    "spheres": {"sphere": [Sphere(position=(0.0, 3.0, 0.0), radius=1.0)], "faces": False},
    "ridges": {"obstacle": [WALL], "faces": True},
    "bodies": {"body": [Body(size=(1.0, 1.0, 1.0), mass=1.0, position=(0.0, -3.0, 0.0))], "faces": False},
    "contact forces": {"contacts": True},
    "bursting": {"balloon": [BRITTLE], "touch": False},
    "corrections": {"correction": "provot"},
    "cached normals": {"balloon": [PUSHED], "normals": "cached"},
}
GPU = SimpleNamespace(is_cpu=False, is_cuda=True, sm_count=132, max_shared_memory_per_block=226 << 10)
"""What `auto` asks of an H100"""
ONLY_LAUNCHED = {"contact forces": "contact forces", "bursting": "balloons that burst"}
"""Those that no block simulates, and what the refusal names"""


@pytest.mark.parametrize("name", CLEARS | DOES_NOT)
def test_worlds_are_clear_where_searches_tell_all_that_may_touch(name: str):
    told: dict[str, Any] = {"balloon": [LIES], "touch": Touch(itself=True), "substeps": 64}
    model = build_model(Scene(**told | (CLEARS | DOES_NOT)[name]), "cpu")
    assert model_features(model).clears == (name in CLEARS)
    assert schedule_named("gather", model) is GatherSchedule
    if name in ONLY_LAUNCHED:
        with pytest.raises(InputError, match=f"^schedule block: does not support {ONLY_LAUNCHED[name]}"):
            schedule_named("block", model)
    else:
        assert schedule_named("block", model) is (SearchedSchedule if name in CLEARS else BlockSchedule)


def test_auto_takes_blocks_for_foil_on_a_gpu():
    film = Balloon(mesh=foil_mesh("I"), material=Material(preset="foil"), inflation=Inflation(pressure=50.0))
    for scene, taken in (
        (Scene(balloon=[film]), ("block", "block", "block")),
        (load_scene("knot"), ("gather", "gather", "block")),
        (load_scene("press"), ("gather", "gather", "gather")),  # its faces meet edges of obstacles
    ):
        model = build_model(scene, "cpu")
        object.__setattr__(model, "device", GPU)
        assert tuple(fastest_schedule(model, worlds) for worlds in (1, 131, 132)) == taken
        assert (schedule_named("block", model) is SearchedSchedule) == ("block" in taken)
