"""Analysis of the arrays that functions of Warp write: by calls, under other names, and in native code."""
# pyright: reportGeneralTypeIssues=false

from typing import Any

import pytest
import warp as wp
from feature_sets import SETS, feature_set

from balloon_warp.kernels.memory import put_vector
from balloon_warp.kernels.phase import effects_of
from balloon_warp.kernels.schedules.launched import GATHERED
from balloon_warp.kernels.substep import phases_of
from balloon_warp.kernels.tables import NAMED, OF_ARRAY, WorldState
from balloon_warp.kernels.warps import add_quanta
from balloon_warp.model import build_model
from balloon_warp.schedules.features import model_features


@wp.struct
class Bag:
    points: wp.array[wp.vec3]


@wp.func
def fill(state: WorldState, world: wp.int32, n: wp.int32):
    state.gas_amounts[world, n] = wp.float64(1.0)
    wp.atomic_add(state.pressures, world, n, 2.0)


@wp.func
def fill_as_named(state: WorldState, world: wp.int32):
    fill(state, world, n=3)


@wp.func
def fill_by_number(n: wp.int32, whole: WorldState):
    fill(whole, 0, n)


@wp.func
def put_in_native_code(spheres: Any):
    put_vector(spheres.sphere_points, 3, wp.vec3())


@wp.func
def put_by_another_name(spheres: Any):
    quanta = spheres.sphere_quanta
    add_quanta(quanta, 0, 0, wp.vec3())


@wp.func
def put_by_a_local_struct(spheres: Any):
    bag = Bag()
    bag.points = spheres.sphere_points
    put_vector(bag.points, 3, wp.vec3())


@wp.func
def only_name(spheres: Any):
    bag = Bag()
    bag.points = spheres.sphere_points
    return bag.points[0]


@wp.func
def change_a_copy(state: WorldState):
    velocity = state.velocities[0, 0]
    velocity[0] = 1.0
    return velocity


@wp.func
def never(state: WorldState):
    if wp.static(False):
        state.airs[0, 0] = wp.vec3()


@pytest.mark.parametrize(
    ("function", "writes"),
    [
        (fill_as_named, {("state", "gas_amounts"), ("state", "pressures")}),
        (fill_by_number, {("whole", "gas_amounts"), ("whole", "pressures")}),
        (put_in_native_code, {("spheres", "sphere_points")}),
        (put_by_another_name, {("spheres", "sphere_quanta")}),
        (put_by_a_local_struct, {("spheres", "sphere_points")}),
        (only_name, set()),
        (never, set()),
    ],
    ids=lambda value: getattr(value, "key", ""),
)
def test_what_a_function_writes(function: Any, writes: set[tuple[str, str]]):
    assert effects_of(function).writes == writes


def test_an_element_that_is_copied_is_read():
    assert ("state", "velocities") in effects_of(change_a_copy).reads
    assert ("state", "velocities") not in effects_of(change_a_copy).writes


def test_arrays_have_one_name():
    assert len(OF_ARRAY) == sum(len(named.arrays) for named in NAMED.values())


@pytest.mark.parametrize(
    ("name", "phase", "changes"),
    [
        ("gas", "pump", {"gas"}),
        ("gas", "flow", {"gas", "pressure", "flow"}),
        ("spheres", "roll", {"sphere", "sphere_force"}),
        ("paper", "leave", {"sphere_push"}),
        ("bodies", "tumble", {"body", "body_contact", "sphere"}),
        ("air and water", "pull", set()),
    ],
)
def test_phases_change_what_they_are_for(name: str, phase: str, changes: set[str]):
    assert name in SETS
    features = model_features(build_model(feature_set(name), "cpu"))
    (found,) = (each for each in phases_of(features) if each.name == phase)
    assert found.changes(features, GATHERED) == changes
