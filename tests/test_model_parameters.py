"""Rows of all parameters, and their places in memory."""

import numpy as np
import pytest
import warp as wp
from meshes import cube

from balloon_warp.kernels.laws import LAWS, PARAMETERS, Parameter
from balloon_warp.kernels.laws.contact import NO_GROUND
from balloon_warp.kernels.laws.outer import NO_WATER
from balloon_warp.model import build_model, initial_state, materials, plan_model, world_bytes
from balloon_warp.model.parameters import ROWS, places_of, rows_of, value_of
from balloon_warp.model.state import Allocating, Counting
from balloon_warp.scene import Balloon, Inflation, Material, Scene
from balloon_warp.scene.load import override_scene

GAS = Inflation(kind="gas")


def everything() -> Scene:
    balloon = {"mesh": cube(), "inflation": GAS, "neck": {}}
    return Scene(
        balloon=[balloon, balloon | {"position": (3.0, 0.0, 0.0)}],
        sphere=[{"position": (0.0, 5.0, 0.0)}],
        string=[{"anchor": (0.0, -3.0, 0.0)}],
        tube=[{"balloons": (0, 1), "conductance": 0.1}],
        force=[{"particles": [0, 1]}],
        obstacle=[{"position": (50.0, -20.0, 0.0)}],
        body=[{"position": (60.0, 5.0, 0.0), "mass": 1.0}],
        **{"ground": {"height": -5.0}, "water": {"level": -4.0}, "touch": {}},
    )


MATERIALS = (
    Material(kind="neo_hookean"),
    Material(kind="mooney_rivlin"),
    Material(kind="ogden", ogden_moduli=(6.3e5, 1.2e3, -1e4), ogden_exponents=(1.3, 5.0, -2.0)),
    Material(kind="gent"),
    Material(kind="neo_hookean", softening=0.1),
    Material(kind="neo_hookean", strength=2e7),
)


def of(material: Material) -> Scene:
    """Return a scene of such balloons, without the features that exclude bursting."""
    scene, own, around = everything(), {"material": material}, {}
    if material.strength is not None:
        own, around = own | {"neck": None}, {"tube": [], "touch": None, "water": None}
    return scene.model_copy(update=around | {"balloon": [each.model_copy(update=own) for each in scene.balloon]})


def scene_that_has(row: Parameter) -> Scene:
    """Return a scene with a material that has the row, or with everything."""
    field = row.path.removeprefix("material.")
    fitting = (of(material) for material in MATERIALS if field in material.own_fields)
    return next(fitting, everything()) if row.path != field else everything()


def test_every_row_stands_in_a_scene():
    """Each row has a place in a scene, and the schema of a law's field agrees with it."""
    scene, rows = everything(), rows_of(LAWS)
    scenes = scene, *map(of, MATERIALS)
    names = {name for each in scenes for places in places_of(each, rows).values() for name, _ in places}
    assert names == {*(row.name for row in rows), "keyframe_values"}
    changed = {"ground_height": -5.0, "water_level": -4.0}
    for row in PARAMETERS.values():
        found = value_of(scene if row.of == "world" else scene.balloon[0], row)
        np.testing.assert_array_equal(found, changed.get(row.name, np.broadcast_to(row.default, np.shape(found))))


@pytest.mark.full
@pytest.mark.parametrize("row", [*PARAMETERS.values(), *ROWS], ids=lambda row: row.name)
def test_every_row_may_differ_between_worlds(row):
    scene = scene_that_has(row)
    if row.name in ("gamma", "molar_mass"):  # which are alike at both ends of a tube
        scene = scene.model_copy(update={"tube": []})
    if row.name == "helium":  # gas lifts by itself
        scene = Scene(balloon=[Balloon(mesh=cube())])
    path = row.path if row.of == "world" else f"{row.of}.{row.path}"
    values = max(row.least, 0.0) + np.array([0.2, 0.4, 0.6])
    if row.most < values[-1]:
        values = values * row.most
    if row.name == "gust_seed":  # a whole number
        values = np.array([1.0, 2.0, 3.0])
    if row.name == "wrinkling":  # or not
        values = np.array([0.0, 1.0, 0.0])
    plan = plan_model(scene, 3, {path if row.size == 1 else f"{path}.1": values})
    if row.name == "initial_rotations":  # of which matrices are made, less 1
        turned = np.degrees(np.arcsin(plan.parameters["initial_turns"][:, 0, 0, 2]))
        np.testing.assert_allclose(turned, values)
        return
    name = {"initial_balloon_positions": "initial_shifts"}.get(row.name, row.name)
    found = plan.parameters[name].reshape(3, -1, row.size)[:, 0, row.size // 2]
    if name == "initial_pressures":  # of so much gas as gives it
        assert plan.parameters["initial_gas_amounts"][0, 0] < plan.parameters["initial_gas_amounts"][1, 0]
    np.testing.assert_allclose(found, values, atol=1e-9)


def test_parameters_of_laws_are_views_into_two_arrays():
    model = build_model(everything(), "cpu", 2, {"balloon.1.mass": [0.3, 0.4]})
    columns, places = model.columns, model.columns.places
    assert model.balloon_numbers.shape == (2, 2, columns.balloon_width)
    assert model.world_numbers.shape == (1, columns.world_width)
    np.testing.assert_allclose(model.balloon_numbers.numpy()[:, :, places["mass"]], [[0.1, 0.3], [0.1, 0.4]])
    model.parameters["wind"].assign(np.array([[1.0, 2.0, 3.0]], dtype=np.float32))
    wind = places["wind"] - columns.balloon_width
    np.testing.assert_array_equal(model.world_numbers.numpy()[0, wind : wind + 3], [1.0, 2.0, 3.0])
    for row in columns.rows:
        assert model.parameters[row.name].dtype == wp.float32
        assert model.parameters[row.name].ndim == (2 if row.of == "balloon" else 1) + (row.size > 1)


def test_a_model_with_its_own_parameters_leaves_the_other_s():
    shared = build_model(everything(), "cpu")
    own = shared.with_own_parameters()
    for name, array in own.parameters.items():
        if array.size and array.dtype == wp.float32:
            before = shared.parameters[name].numpy().copy()
            array.assign(np.full(before.shape, 7.0, dtype=np.float32))
            np.testing.assert_array_equal(shared.parameters[name].numpy(), before)
    assert (own.balloon_numbers.numpy() == 7.0).all()
    assert (own.world_numbers.numpy() == 7.0).all()


def test_one_world_has_the_numbers_that_it_has_among_others():
    vary = {"balloon.1.mass": [0.3, 0.4], "gravity": [1.0, 2.0], "sphere.mass": [3.0, 4.0]}
    one = build_model(everything(), "cpu", 2, vary).of_world(1)
    assert one.world_count == 1
    np.testing.assert_allclose(one.parameters["mass"].numpy(), [[0.1, 0.4]])
    np.testing.assert_allclose(one.parameters["gravity"].numpy(), [2.0])
    np.testing.assert_allclose(one.parameters["sphere_mass"].numpy(), [[4.0]])


@pytest.mark.full
@pytest.mark.parametrize(
    "path", ["balloon.stiffness.structural", "balloon.mass", "balloon.drag_coefficient", "gravity"]
)
def test_the_step_of_many_worlds_is_that_of_the_stiffest(path, monkeypatch):
    """The step is that of the stiffest world, whatever the block of worlds."""
    scene, values = everything(), np.linspace(1.0, 40.0, 7)
    monkeypatch.setattr(materials, "CHUNK", 20)
    alone = [plan_model(override_scene(scene, [(path, value)])).substeps for value in values]
    assert plan_model(scene, 7, {path: values}).substeps == max(alone)


def test_without_ground_and_water_they_are_far_below():
    model = build_model(Scene(balloon=[Balloon(mesh=cube())]), "cpu")
    assert model.parameters["ground_height"].numpy() == np.float32(NO_GROUND)
    assert model.parameters["water_level"].numpy() == np.float32(NO_WATER)


def test_what_is_counted_is_what_is_allocated():
    room = Counting()
    for shape, dtype in (((3, 4), wp.vec3), (5, wp.float64), ((2, 0), wp.int32), ((1, 2, 3), wp.vec2)):
        before, array = room.bytes, Allocating(wp.get_device("cpu")).array(shape, dtype)
        assert room.array(shape, dtype) is None
        assert room.bytes - before == array.size * wp.types.type_size_in_bytes(dtype)
    model = build_model(everything(), "cpu", 2)
    state = initial_state(model)
    taken = sum(array.size * wp.types.type_size_in_bytes(array.dtype) for array in state.arrays.values())
    assert 2 * world_bytes(model) == taken + 4  # the number of the frame, which both have
