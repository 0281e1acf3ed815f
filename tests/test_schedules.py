"""Schedules against themselves: a repeated run, and a world alone against the same world in a batch; their tables."""

from dataclasses import replace

import numpy as np
import pytest
import warp as wp
from feature_sets import feature_set
from meshes import quad_sphere
from method_scenes import SCENES
from numpy.typing import NDArray
from trajectories import ROUNDING, after_frames, arrays, assert_close

from balloon_warp import Balloon, Ground, Inflation, InputError, PolygonMesh, Scene, Simulator, Sphere, Water
from balloon_warp.model import build_model, initial_state, lay_out, plan_model
from balloon_warp.schedules import make_schedule
from balloon_warp.schedules import slices as module
from balloon_warp.schedules.gather import ScatterSchedule
from balloon_warp.schedules.slices import memoized, neighbors_in_slots, spread_over_banks, spring_ends, wavefronts
from balloon_warp.schedules.tables import other_corners


@pytest.mark.full
def test_a_particle_with_few_faces_may_stand_at_the_origin(schedule, device):
    """Padding of octets' face tables does not reach a particle at the origin, with three faces beside four."""
    ball = quad_sphere(3, radius=0.5)
    corner = int(np.argmax(ball.points.sum(axis=1)))
    x, y, z = (-ball.points[corner]).tolist()
    still = Balloon(mesh=ball, position=(x, y, z), helium=9.81, inflation=Inflation(k_normal=1e-5), damping=0.0)
    scene = Scene(balloon=[still], normals="fresh", gravity=9.81)
    simulators = [after_frames(scene, name, device, 1) for name in (schedule, "scatter")]
    found, expected = (arrays(simulator) for simulator in simulators)
    np.testing.assert_allclose(expected["points"][0, corner], 0.0, atol=ROUNDING)
    moved, reference = (simulator.state.velocities.numpy()[0] for simulator in simulators)
    assert np.linalg.norm(reference[corner]) > 1e-5  # by its nearest face
    np.testing.assert_allclose(moved, reference, rtol=1e-3, atol=1e-7)
    assert_close(found, expected, ROUNDING)


def test_a_fixed_particle_feels_neither_sphere_nor_ground(schedule, device):
    ball = quad_sphere(3, radius=0.5)
    fixed = [int(np.argmin(ball.points[:, 1])), int(np.argmax(ball.points[:, 1]))]
    scene = Scene(
        balloon=[Balloon(mesh=ball, position=(0.0, 0.4, 0.0), fixed=fixed)],
        sphere=[Sphere(position=(0.0, 0.9, 0.0), radius=0.3)],
        ground=Ground(),
    )
    start, moved = (arrays(after_frames(scene, schedule, device, frames))["points"][0] for frames in (0, 2))
    np.testing.assert_array_equal(moved[fixed], start[fixed])
    start_of_others, others = (np.delete(points, fixed, axis=0) for points in (start, moved))
    assert start[fixed[0], 1] < -0.05
    assert start_of_others[:, 1].min() < -0.05
    assert others[:, 1].min() > -1e-6


@pytest.mark.full
def test_among_thousands_of_worlds_sums_have_the_order_of_one(device):
    """The order of a sum does not depend on the number of worlds, by which a GPU's threads might be chosen."""
    ball = quad_sphere(3, radius=0.2)
    gas = Balloon(mesh=ball, position=(0.0, 1.0, 0.0), inflation=Inflation(kind="gas", start_pressure=40.0))
    alone, among = (arrays(after_frames(Scene(balloon=[gas]), "gather", device, 2, worlds=n)) for n in (1, 2100))
    for field in ("points", "velocities", "pressures"):
        np.testing.assert_array_equal(among[field][2099], alone[field][0], err_msg=field)


PER_WORLD = (
    *("structural", "shear", "flexion", "torsion", "viscosity", "yield_stretch", "correction_limit", "mass", "helium"),
    *("damping", "keyframe_values", "gravity", "initial_gas_amounts", "initial_free_volumes", "gamma"),
    *("breathing_damping", "molar_mass", "drag_coefficient", "tube_conductance", "air_pressure", "air_temperature"),
    *("air_density", "wind", "sphere_mass", "sphere_radius", "sphere_penalty", "string_length", "string_stiffness"),
    *("string_anchor", "pair_frictions", "ground_restitution"),
)


def states_of_worlds(name: str, factors: np.ndarray, schedule: str, device: str) -> dict[str, np.ndarray]:
    """Return the state of a batch after three frames, each world with its parameters times a factor."""
    plan = plan_model(SCENES[name], len(factors))
    names = [each for each in PER_WORLD if each in plan.parameters]
    varied = {name: np.concatenate([factor * plan.parameters[name] for factor in factors]) for name in names}
    varied["ground_height"] = plan.parameters["ground_height"] + 0.02 * (factors - 1.0)
    model = lay_out(replace(plan, parameters=plan.parameters | varied), device)
    state = initial_state(model)
    advance = make_schedule(model, schedule)
    for _ in range(3):
        advance.advance_frame(state)
    return {field: array.numpy().copy() for field, array in state.arrays.items() if field != "frame"}


@pytest.mark.full
@pytest.mark.parametrize("name", ["paper", "gas", "more", "more by penalty, dry", "more corrected"])
def test_a_world_of_a_batch_is_to_the_last_bit_that_world_alone_and_again(name, schedule, device):
    """Worlds differ, and no eight divide their number. No factor is 1: a yield stretch that is as good as infinite
    would leave a law out of that world alone, and other kernels round differently on a GPU."""
    factors = np.linspace(0.9, 1.11, 11)
    batch, again = (states_of_worlds(name, factors, schedule, device) for _ in range(2))
    for field, values in batch.items():
        np.testing.assert_array_equal(again[field], values, err_msg=field)
    for world in (0, 3, 10):
        for field, of_one in states_of_worlds(name, factors[world : world + 1], schedule, device).items():
            np.testing.assert_array_equal(batch[field][world], of_one[0], err_msg=f"{field} of world {world}")
    assert (batch["points"][4] != batch["points"][0]).any()


def bare(**fields) -> Scene:
    """Return a balloon and nothing else."""
    balloon = Balloon(mesh=quad_sphere(3), helium=12.0, inflation=Inflation(k_normal=0.2))
    return Scene(balloon=[balloon], normals="cached", substeps=33, **fields)


@pytest.mark.full
@pytest.mark.parametrize(
    ("scene", "kernels"),
    [
        (bare(), ["elements_add_forces", "particles_pull_to_move"]),
        (feature_set("springs"), ["elements_add_forces", "faces_add_area_vectors", "particles_pull_to_leave"]),
        (bare(water=Water()), ["elements_add_forces", "particles_soak_to_push", "particles_move"]),
    ],
    ids=["springs", "strings, hinges and a pressure", "water"],
)
def test_a_substep_of_scatter_is_few_launches(scene, kernels, monkeypatch):
    """A substep of `scatter` is few launches, which on a GPU take a single balloon as much time as its work. In water
    none may move before all have been looked at. Nothing is copied."""
    model = build_model(scene, "cpu")
    state, scatter = initial_state(model), ScatterSchedule(model)
    launched = []
    monkeypatch.setattr(wp, "launch", lambda kernel, *args, **more: launched.append(kernel.func.__name__))
    monkeypatch.setattr(wp, "copy", lambda *args: launched.append("copy"))
    scatter.launches.substep(state, 1, (state.points, state.velocities))
    assert launched == kernels


def test_an_unknown_schedule_is_refused():
    with pytest.raises(InputError, match="schedule weave: no such schedule; known are auto, scatter, gather"):
        Simulator(bare(), "cpu", schedule="weave")


def test_auto_takes_a_schedule_and_says_which():
    assert Simulator(bare(), "cpu").schedule.name == "octets"
    assert Simulator(bare(), "cpu", 8).schedule.name == "lanes"


@pytest.mark.full
def test_a_world_too_large_for_a_block_is_refused_and_not_taken_by_auto(device):
    scene = Scene(balloon=[Balloon(mesh=quad_sphere(43), mass=50.0)])
    with pytest.raises(InputError, match=r"^schedule block: a world of 11,096 particles is too large .* use gather$"):
        Simulator(scene, device, schedule="block")
    assert Simulator(scene, device).schedule.name == ("octets" if device == "cpu" else "gather")


def test_wavefronts_are_counted_by_hand():
    own = np.arange(64)
    assert wavefronts(own[None]) == 1.0
    clash = own.copy()
    clash[1] = 32  # bank 0 for thread 1, beside particle 0 for thread 0
    clash[32:] = 7  # the same word for all threads
    assert wavefronts(clash[None]) == (2 + 1) / 2


def test_slots_are_ordered_against_bank_conflicts_and_keep_neighbors():
    scene = Scene(balloon=[Balloon(mesh=quad_sphere(9), mass=5.0)])
    ends = spring_ends(build_model(scene, "cpu"))
    found = neighbors_in_slots(ends, 0)
    neighbors = np.where(found < 0, np.arange(488), found)
    spread = np.take_along_axis(neighbors, spread_over_banks(neighbors), axis=0)
    np.testing.assert_array_equal(np.sort(spread, axis=0), np.sort(neighbors, axis=0))
    assert wavefronts(neighbors) > 1.8
    assert wavefronts(spread) < 1.4


def test_what_was_found_is_not_sought_again():
    sought: list[list[int]] = []

    @memoized
    def doubled(values: NDArray[np.int64]) -> NDArray[np.int64]:
        sought.append(values.tolist())
        return 2 * values

    first, other = np.arange(4), np.arange(4).reshape(2, 2)
    assert doubled(first).tolist() == doubled(first.copy()).tolist() == [0, 2, 4, 6]
    assert doubled(other).tolist() == [[0, 2], [4, 6]]
    first[0] = 5
    assert doubled(first).tolist() == [10, 2, 4, 6]
    assert sought == [[0, 1, 2, 3], [[0, 1], [2, 3]], [5, 1, 2, 3]]


def test_an_answer_cannot_be_spoiled_and_only_the_last_are_kept(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(module, "LAST", 2)
    sought: list[int] = []

    @memoized
    def same(values: NDArray[np.int64]) -> NDArray[np.int64]:
        sought.append(int(values[0]))
        return values

    for number in (0, 1, 0, 2, 0, 1):
        answer = same(given := np.array([number]))
        given[0] = 7
        assert answer.tolist() == [number]
        with pytest.raises(ValueError, match="read-only"):
            answer[0] = 1
    assert sought == [0, 1, 2, 1]


FACES = ((0, 1, 2), (2, 1, 3, 4), (4, 3, 5, 6, 0))


def test_each_corner_has_the_rest_of_its_face_in_turn():
    points = np.random.default_rng(0).normal(size=(7, 3))
    mesh = PolygonMesh(points, np.array([3, 4, 5]), np.concatenate(FACES))
    corners = other_corners(build_model(Scene(balloon=[{"mesh": mesh, "holes": "keep"}]), "cpu"))
    listed = [face[turn:] + face[:turn] for face in FACES for turn in range(len(face))]
    expected = sorted(listed, key=lambda fan: fan[0])  # stable: those of a particle in the order of the faces
    assert corners.particles.tolist() == [fan[0] for fan in expected]
    assert corners.sizes.tolist() == [len(fan) - 1 for fan in expected]
    assert np.diff(corners.begins).tolist() == corners.sizes.tolist()
    assert corners.others.tolist() == [corner for fan in expected for corner in fan[1:]]
