"""Code that kernels share: rows of parameters, algebra, tables, options of the compiler, what functions write."""
# pyright: reportGeneralTypeIssues=false

import re
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import warp as wp
from feature_sets import SETS, feature_set
from meshes import cube, quad_sphere
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation
from warp._src import codegen

from balloon_warp.kernels import NO_DERIVATIVES, OPTIONS
from balloon_warp.kernels.algebra import (
    cross_product,
    dot_product,
    inverse_root,
    larger,
    length_of,
    plus_scaled,
    reach_along,
    scaled,
    squared_length,
    times,
)
from balloon_warp.kernels.lanes import LANE_COUNT, Lanes, Lanes3, Lanes5
from balloon_warp.kernels.laws import LAWS, PARAMETERS, Parameter
from balloon_warp.kernels.memory import put_vector
from balloon_warp.kernels.phase import effects_of
from balloon_warp.kernels.tables import NAMED, OF_ARRAY, WorldState
from balloon_warp.kernels.warps import add_quanta
from balloon_warp.model import build_model, plan_model
from balloon_warp.model.clearance import Solid
from balloon_warp.model.parameters import ROWS, places_of, rows_of, value_of
from balloon_warp.scene import Balloon, Inflation, Obstacle, Scene
from balloon_warp.schedules.slices import kind_slots, quad_rings, slot_table, spring_ends


def test_every_row_stands_in_a_scene():
    rows = rows_of(LAWS)
    names = {name for each in SETS for places in places_of(feature_set(each), rows).values() for name, _ in places}
    assert names == {*(row.name for row in rows), "keyframe_values"}
    tables = {"ground": {"height": -5.0}, "water": {"level": -4.0}, "touch": {}}
    plain = Scene(balloon=[{"mesh": cube(), "inflation": {"kind": "gas"}, "neck": {}}], **tables)
    changed = {"ground_height": -5.0, "water_level": -4.0}
    for row in PARAMETERS.values():  # of which the schema's fields have the defaults
        found = value_of(plain if row.of == "world" else plain.balloon[0], row)
        np.testing.assert_array_equal(found, changed.get(row.name, np.broadcast_to(row.default, np.shape(found))))


WHERE = {"fill_breaths": "bursting", "fill_litres": "bursting", "fill_moles": "bursting", "water_evened": "all"}
"""Sets by rows that the first sets with their fields refuse, or have no use for"""


def place_of(row: Parameter) -> tuple[Scene, str, tuple]:
    """Return a set that has the row, a path to it, and its index in the plan."""
    for name in [WHERE[row.name]] if row.name in WHERE else SETS:
        scene = feature_set(name).model_copy(update={"substeps": "auto"})
        for path, places in places_of(scene, rows_of(LAWS)).items():
            if len(places) == 1 and places[0][0] == row.name:
                return scene, path, places[0][1]
    raise AssertionError(row.name)


@pytest.mark.full
@pytest.mark.parametrize("row", [*PARAMETERS.values(), *ROWS], ids=lambda row: row.name)
def test_every_row_may_differ_between_worlds(row):
    scene, path, index = place_of(row)
    if row.of == "balloon":  # gases at both ends of a tube are alike
        scene = scene.model_copy(update={"tube": []})
    values = max(row.least, 0.0) + np.array([0.2, 0.4, 0.6])
    if row.most < values[-1]:
        values = values * row.most
    values += 5.0 * (row.name == "initial_body_positions")  # outside of the balloon
    values = {"gust_seed": np.arange(3.0), "wrinkling": np.array([0.0, 1.0, 0.0])}.get(row.name, values)
    found = plan_model(scene, 3, {path: values}).parameters
    if row.name == "initial_rotations":  # of which matrices are made, less 1
        assert (np.diff(found["initial_turns"][:, 0], axis=0) != 0.0).any(axis=(1, 2)).all()
    elif row.name == "initial_pressures":  # of so much gas as gives it
        assert (np.diff(found["initial_gas_amounts"][:, 0]) > 0.0).all()
    else:
        name = {"initial_balloon_positions": "initial_shifts"}.get(row.name, row.name)
        np.testing.assert_allclose(found[name][(slice(None), *index)], values, atol=1e-9)


ALGEBRA = wp.get_module(f"{__name__}.algebra")
ALGEBRA.options |= {"enable_backward": True}


@wp.kernel(module=ALGEBRA)
def in_lanes(
    vectors: wp.array[Lanes3], numbers: wp.array[Lanes], fives: wp.array[Lanes5], factor: wp.array[float],
    way: wp.array[wp.vec3], of_vectors: wp.array[Lanes3], of_numbers: wp.array[Lanes], of_fives: wp.array[Lanes5],
):  # fmt: skip
    a = vectors[0]
    b = vectors[1]
    f = numbers[0]
    g = numbers[1]
    of_vectors[0] = cross_product(a, b)
    of_vectors[1] = scaled(a, f)
    of_vectors[2] = scaled(a, factor[0])
    of_vectors[3] = plus_scaled(a, b, f)
    of_numbers[0] = dot_product(a, b)
    of_numbers[1] = reach_along(a, way[0])
    of_numbers[2] = times(f, g)
    of_numbers[3] = times(factor[0], f)
    of_numbers[4] = scaled(f, g)
    of_numbers[5] = larger(f, g)
    of_numbers[6] = squared_length(a)
    of_numbers[7] = length_of(a)
    of_fives[0] = scaled(fives[0], f)


@wp.kernel(module=ALGEBRA)
def one_by_one(
    vectors: wp.array2d[wp.vec3], numbers: wp.array2d[float], fives: wp.array3d[float], factor: wp.array[float],
    way: wp.array[wp.vec3], of_vectors: wp.array2d[wp.vec3], of_numbers: wp.array2d[float], of_fives: wp.array3d[float],
):  # fmt: skip
    lane = wp.tid()
    a = vectors[0, lane]
    b = vectors[1, lane]
    f = numbers[0, lane]
    g = numbers[1, lane]
    of_vectors[0, lane] = cross_product(a, b)
    of_vectors[1, lane] = scaled(a, f)
    of_vectors[2, lane] = scaled(a, factor[0])
    of_vectors[3, lane] = a + scaled(b, f)
    of_numbers[0, lane] = dot_product(a, b)
    of_numbers[1, lane] = reach_along(a, way[0])
    of_numbers[2, lane] = times(f, g)
    of_numbers[3, lane] = times(factor[0], f)
    of_numbers[4, lane] = f * g
    of_numbers[5, lane] = wp.max(f, g)
    of_numbers[6, lane] = squared_length(a)
    of_numbers[7, lane] = (
        length_of(a) * squared_length(a) * inverse_root(squared_length(a)) * inverse_root(wp.dot(a, a))
    )
    for row in range(5):
        of_fives[0, row, lane] = fives[0, row, lane] * f


RNG = np.random.default_rng(2)
VECTORS, NUMBERS, FIVES, FACTOR, WAY = (
    RNG.uniform(-2.0, 2.0, shape).astype(np.float32)
    for shape in ((2, LANE_COUNT, 3), (2, LANE_COUNT), (1, 5, LANE_COUNT), (1,), (1, 3))
)
(A, B), (F, G) = VECTORS.astype(float), NUMBERS.astype(float)
EXPECTED = (
    np.stack([np.cross(A, B), F[:, None] * A, float(FACTOR[0]) * A, A + F[:, None] * B]),
    np.stack([(A * B).sum(axis=1), A @ WAY[0], F * G, FACTOR[0] * F, F * G, np.maximum(F, G),
              (A**2).sum(axis=1), np.linalg.norm(A, axis=1)]),
    FIVES * F,
)  # fmt: skip


def launched(lanes: bool) -> tuple[list[NDArray[Any]], list[NDArray[Any]]]:
    """Return the results, and the derivatives of a weighted sum of vectors and numbers by all inputs but the fives, by
    which none is taken."""

    def array(values: NDArray[Any], dtype: Any) -> wp.array:
        return wp.array(values, dtype=dtype, device="cpu", requires_grad=True)

    def turned(vectors: NDArray[Any], *others: NDArray[Any]) -> list[NDArray[Any]]:
        return [np.swapaxes(vectors, 1, 2) if lanes else vectors, *others]

    kinds = [Lanes3, Lanes, Lanes5, float, wp.vec3] if lanes else [wp.vec3, float, float, float, wp.vec3]
    inputs = list(map(array, turned(VECTORS, NUMBERS, FIVES, FACTOR, WAY), kinds))
    out = [array(np.zeros_like(each), kind) for each, kind in zip(turned(*EXPECTED), kinds, strict=False)]
    with wp.Tape() as tape:
        wp.launch(in_lanes if lanes else one_by_one, 1 if lanes else LANE_COUNT, [*inputs, *out], device="cpu")
    rng = np.random.default_rng(3)
    weights = turned(*(rng.uniform(-1.0, 1.0, each.shape) for each in EXPECTED[:2]))
    tape.backward(grads={out[i]: wp.array(weights[i], dtype=kinds[i], device="cpu") for i in range(2)})
    slopes = [tape.gradients[inputs[i]].numpy() for i in (0, 1, 3, 4)]
    return turned(*(each.numpy() for each in out)), turned(*slopes)


@pytest.mark.parametrize("lanes", [False, True], ids=["one", "eight"])
def test_functions_are_those_of_numpy(lanes: bool):
    """The tolerance is some roundings of numbers of up to 12."""
    for found, expected in zip(launched(lanes)[0], EXPECTED, strict=True):
        np.testing.assert_allclose(found, expected, atol=2e-6)


def test_derivatives_of_eight_are_those_of_each():
    for found, expected in zip(launched(True)[1], launched(False)[1], strict=True):
        assert np.abs(expected).min() > 0.0
        np.testing.assert_allclose(found, expected, atol=1e-5)


@pytest.mark.parametrize("ringed", [False, True])
def test_slots_have_each_particle_s_springs_first(ringed: bool):
    """Structural and shear springs go around a particle in its ring; slots left over are of no stiffness."""
    balls = [
        Balloon(mesh=quad_sphere(3), position=(4.0 * number, 0.0, 0.0), inflation=Inflation(kind="gas"))
        for number in range(2)
    ]
    model = build_model(Scene(balloon=balls), "cpu")
    ends, ring = spring_ends(model), quad_rings(model)
    assert ring is not None
    table, materials = slot_table(model, ends, ring if ringed else None), np.cumsum([0, *kind_slots(ends)])
    neighbors, scales, lengths = (getattr(table, each).numpy() for each in ("neighbors", "scales", "rest_lengths"))
    for particle, kind in np.ndindex(model.particle_count, 3):
        own = (ends.particle == particle) & (ends.kind == kind)
        known = sorted(zip(ends.neighbor[own], ends.scale[own], ends.rest_length[own].astype(np.float32), strict=True))
        slots, used = slice(materials[kind], materials[kind + 1]), own.sum()
        found = list(zip(*(each[slots, particle] for each in (neighbors, scales, lengths)), strict=True))
        assert sorted(each for each in found if each[1] > 0.0) == known
        assert {each[0] for each in found if each[1] == 0.0} <= {particle}
        if ringed and kind < 2:
            assert neighbors[slots, particle][:used].tolist() == ring[kind][:used, particle].tolist()
    assert table.valences.numpy().tolist() == ends.by_kind[:, 0].tolist()


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
def put_by_another_name(spheres: Any):
    quanta = spheres.sphere_quanta
    add_quanta(quanta, 0, 0, wp.vec3())


@wp.func
def put_by_a_local_struct(spheres: Any):
    bag = Bag()
    bag.points = spheres.sphere_points
    put_vector(bag.points, 3, wp.vec3())


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
        (put_by_another_name, {("spheres", "sphere_quanta")}),
        (put_by_a_local_struct, {("spheres", "sphere_points")}),
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


@wp.struct
class Pair:
    """Two numbers, whose derivatives add up."""

    first: float
    second: float


@wp.kernel(module="unique", module_options={"optimization_level": 0})
def multiply(pairs: wp.array(dtype=Pair), products: wp.array[float]):
    pair = pairs[wp.tid() // 2]
    products[wp.tid()] = pair.first * pair.second


def test_how_structs_are_derived_is_left_out_of_our_kernels():
    """Nothing but the code between our macro's lines is derived: it was a third of a small kernel's time."""
    flag = f"-D{NO_DERIVATIVES}="
    assert flag in OPTIONS["cpu_compiler_flags"].split()
    written = codegen.codegen_struct(Pair)
    left_out = re.compile(rf"#ifndef {NO_DERIVATIVES}\n(.*?)#endif\n", re.DOTALL)
    assert len(left_out.findall(written)) == 2
    assert "adj_" in written
    assert "adj_" not in left_out.sub("", written)


def test_a_kernel_that_asks_for_them_adds_derivatives_of_threads_that_read_the_same():
    numbers = np.array([(2.0, 3.0), (5.0, 7.0)], dtype=Pair.numpy_dtype())
    pairs = wp.array(numbers, dtype=Pair, device="cpu", requires_grad=True)
    products = wp.zeros(4, dtype=float, device="cpu", requires_grad=True)
    with wp.Tape() as tape:
        wp.launch(multiply, 4, [pairs], [products], device="cpu")
    tape.backward(grads={products: wp.ones_like(products)})
    assert pairs.grad is not None
    np.testing.assert_array_equal(products.numpy(), [6.0, 6.0, 35.0, 35.0])
    assert [tuple(each) for each in pairs.grad.numpy().tolist()] == [(6.0, 4.0), (14.0, 10.0)]


@pytest.mark.parametrize("thickness", [0.0, 0.03])
def test_the_box_around_an_obstacle_has_its_thickness_on_each_side(thickness: float):
    plan = plan_model(Scene(balloon=[Balloon(mesh=quad_sphere(2))], obstacle=[Obstacle(size=(1.0, 0.4, 0.6))]))
    shape = replace(plan.obstacles[0], thickness=thickness)
    lowest, highest = Solid(shape, np.array([0.0, 1.0, 0.0]), Rotation.identity()).bounds
    np.testing.assert_allclose(highest, np.array([0.5, 0.2, 0.3]) + thickness)
    np.testing.assert_allclose(lowest, -highest)
