"""Values set between steps: `simulator.set({...})`, and the frames that `step` returns."""

import copy
import pickle
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from meshes import cube, quad_sphere
from trajectories import stepped

from balloon_warp import Balloon, Change, Inflation, InputError, Material, Scene, Simulator, Sphere, Stiffness, String

SECONDS = 1 / 60
"""of a frame"""
STILL = Balloon(
    mesh=cube(), stiffness=Stiffness(structural=0, shear=0, flexion=0), inflation=Inflation(pressure=0.0), damping=0.0
)
BUSY = Scene(
    balloon=[Balloon(mesh=quad_sphere(3, 0.5), inflation=Inflation(pressure=[(0.0, 5.0), (0.5, 9.0)]))],
    sphere=[Sphere(position=(0.0, 0.8, 0.0), radius=0.4)],
    string=[String(anchor=(0.0, -1.0, 0.0), length=0.4)],
    substeps=24,
)
SETS = {
    "numbers": {"gravity": 5.0, "balloon.mass": 0.15, "balloon.0.stiffness.shear": 12.0, "sphere.radius": 0.45},
    "vectors": {"string.0.anchor": (0.1, -1.0, 0.2), "atmosphere.wind": np.array([1.0, 0.0, 2.0])},
    "a table": {"balloon.stiffness": {"structural": 12.0, "shear": 5.0}},
    "keyframes": {"balloon.inflation.pressure": 30.0},
    "a keyframe": {"balloon.inflation.pressure.1.1": 30.0},
    "methods": {"contact": "impulse", "correction": "provot", "substeps": 30},
    "laws at rest": {"balloon.drag_coefficient": 0.5, "balloon.stiffness.torsion": 1e-3, "balloon.helium": 3.0},
}
"""on the way, of `BUSY`"""
MISTAKES = {
    "a name": ({"balloon.mas": 1.0}, r"balloon\.0\.mas: unknown field; did you mean mass\?"),
    "a bound": ({"balloon.mass": -1.0}, r"balloon\.0\.mass: must be greater than 0 \(got -1\.0\)"),
    "a world's bound": ({"balloon.mass": [1.0, -2.0]}, r"balloon\.0\.mass: must be .* \(got -2\.0\), in world 1"),
    "worlds": ({"balloon.mass": [1.0, 2.0, 3.0]}, r"balloon\.mass: expected a value for each of 2 worlds"),
    "a choice": ({"normals": "fres"}, r"normals: must be 'cached' or 'fresh' \(got 'fres'\)"),
    "the mesh": ({"balloon.mesh": "a.obj"}, r"balloon\.mesh: cannot change; what can: substeps, "),
    "the start": ({"balloon.position": (0, 1, 0)}, r"balloon\.position: cannot change"),
    "how many": ({"sphere": []}, r"sphere: cannot change"),
    "no such thing": ({"sphere.5.mass": 2.0}, r"sphere\.5\.mass: no sphere 5, the scene has 2"),
    "not there yet": ({"sphere.1.radius": 0.2}, r"sphere\.1\.radius: sphere 1 does not exist in frame 1"),
    "auto": (
        {"balloon.inflation.pressure": "auto"},
        r"pressure: must be a number during the simulation \(got \"auto\"\)",
    ),
    "new keyframes": ({"balloon.inflation.pressure": [(0, 1), (1, 2)]}, r"must be a number .* \(got keyframes\)"),
    "another kind": ({"balloon.inflation.moles": 1.0}, r'moles: needs kind = "gas" \(got kind = "pressure"\)'),
    "a new table": ({"water.level": 1.0}, r"water\.level: cannot change"),
    "too long a step": ({"balloon.stiffness.structural": 1e6}, r"substeps: 24 are too few for these springs"),
    "no mapping": ([("balloon.mass", 2.0)], r"set: must be paths and values, as in "),
}


def points(simulator: Simulator) -> np.ndarray:
    return simulator.state.points.numpy().copy()


def test_a_step_hands_out_the_frame_of_a_world(device: str):
    simulator = Simulator(BUSY, device, vary={"balloon.mass": [0.1, 0.2]})  # as many worlds as values
    frame, second = simulator.step(), simulator.step(world=1)
    assert (frame.number, second.number) == (1, 2)
    np.testing.assert_array_equal(second.points[0], points(simulator)[1])
    assert np.abs(second.points[0] - frame.points[0]).max() > 1e-4
    with pytest.raises(InputError, match="no world 2"):
        simulator.step(world=2)
    with pytest.raises(InputError, match=r"^frames: expected at least 1 \(got 0\)$"):
        simulator.step(0)
    assert simulator.frame_number == 2
    assert simulator.step(3, world=1).number == 5


def test_gravity_that_is_set_bends_the_fall(device: str, schedule: str):
    """The velocity is -(g1 + g2) n h after n steps under g1, then n under g2 of each world."""
    simulator = Simulator(Scene(balloon=[STILL], gravity=10.0, substeps=3), device, 2, schedule=schedule)
    stepped(simulator, 2).set({"gravity": [30.0, 4.0]})
    stepped(simulator, 2)
    falls = simulator.state.velocities.numpy()[:, :, 1].T
    np.testing.assert_allclose(falls, np.tile([-(10.0 + 30.0) * 2 / 60, -(10.0 + 4.0) * 2 / 60], (8, 1)), rtol=1e-5)


@pytest.mark.full
@pytest.mark.parametrize("name", SETS)
def test_what_is_set_does_what_the_same_change_of_a_scene_does(name: str, device: str):
    """A set value is bit-identical to the planned change of a scene, for which kernels are prepared."""
    listed = {path: list(value) if isinstance(value, np.ndarray) else value for path, value in SETS[name].items()}
    planned = Simulator(BUSY.model_copy(update={"change": [Change(time=2 * SECONDS, set=listed)]}), device)
    simulator = stepped(Simulator(BUSY, device), 2)
    simulator.set(SETS[name])
    np.testing.assert_array_equal(points(stepped(simulator, 3)), points(stepped(planned, 5)))
    assert np.abs(points(simulator) - points(stepped(Simulator(BUSY, device), 5))).max() > 1e-6


def test_each_world_gets_its_own(device: str):
    masses, anchors = [0.1, 0.4], np.array([[0.0, -1.0, 0.0], [0.5, -1.0, 0.5]])
    simulator = stepped(Simulator(BUSY, device, 2), 1)
    simulator.set({"balloon.mass": masses, "string.0.anchor": anchors})
    stepped(simulator, 3)
    for world in (0, 1):
        alone = stepped(Simulator(BUSY, device), 1)
        alone.set({"balloon.mass": masses[world], "string.0.anchor": anchors[world]})
        np.testing.assert_array_equal(points(simulator)[world], points(stepped(alone, 3))[0])


@pytest.mark.full
def test_what_follows_from_a_value_follows():
    film = Balloon(mesh=quad_sphere(3), material=Material(preset="latex"), inflation=Inflation(pressure=10.0))
    simulator = Simulator(Scene(balloon=[film]), "cpu")
    mass, substeps = float(simulator.model.parameters["mass"].numpy()[0, 0]), simulator.model.substeps
    simulator.set({"balloon.material.thickness": 4.0 * film.material.value("thickness")})
    assert float(simulator.model.parameters["mass"].numpy()[0, 0]) == pytest.approx(4.0 * mass)
    assert simulator.model.substeps == substeps  # the frequency is that of the material
    pair = Scene(balloon=[Balloon(mesh=quad_sphere(3)), Balloon(mesh=quad_sphere(3), position=(2.5, 0, 0))])
    stiff = {"balloon.stiffness": {"structural": 80.0, "shear": 40.0, "flexion": 8.0}}
    plan = pair.model_copy(update={"change": [Change(time=0.5 / 60.0, set=stiff)]})
    before, told, planned = (Simulator(scene, "cpu") for scene in (pair, pair, plan))
    told.set(stiff)
    stepped(planned, 2)
    own = [each.model.parameters["touch_stiffnesses"].numpy()[0] for each in (before, told, planned)]
    np.testing.assert_allclose(own[1:], 4.0 * np.stack([own[0]] * 2), rtol=1e-6)
    substeps = [each.model.substeps for each in (before, told, planned)]
    assert substeps[1] == substeps[2] > 1.5 * substeps[0]  # of twice the frequency, rounded up


@pytest.mark.full
def test_what_the_scene_plans_happens_later_and_what_is_set_stays():
    changes = [Change(time=2 * SECONDS, set={"gravity": 3.0}), Change(time=3 * SECONDS, set={"correction": "provot"})]
    simulator = Simulator(BUSY.model_copy(update={"change": changes}), "cpu")
    simulator.set({"gravity": 5.0, "contact": "impulse", "substeps": 48})
    gravities = []
    for _ in range(4):
        simulator.step()
        gravities.append(float(simulator.model.parameters["gravity"].numpy()[0]))
    assert gravities == [5.0, 5.0, 3.0, 3.0]
    scene = simulator.model.scene
    assert (scene.contact, scene.correction, simulator.model.substeps) == ("impulse", "provot", 48)


@pytest.mark.parametrize("mistake", MISTAKES)
def test_what_cannot_be_set_is_one_sentence_and_nothing_changes(mistake: str):
    given, said = MISTAKES[mistake]
    late = [*BUSY.sphere, Sphere(position=(0, 5, 0), start=1.0)]
    simulator = stepped(Simulator(BUSY.model_copy(update={"sphere": late}), "cpu", 2), 1)
    before = {name: array.numpy().copy() for name, array in simulator.model.parameters.items()}
    with pytest.raises(InputError, match=said):
        simulator.set({"gravity": 1.0, **given} if isinstance(given, dict) else given)
    for name, values in before.items():
        np.testing.assert_array_equal(simulator.model.parameters[name].numpy(), values, err_msg=name)


def test_reset_forgets_what_was_set(device: str):
    simulator = Simulator(BUSY, device)
    first = points(stepped(simulator, 2))
    simulator.set({"balloon.mass": 0.3, "contact": "impulse"})
    stepped(simulator, 1).reset()
    np.testing.assert_array_equal(points(stepped(simulator, 2)), first)


@pytest.mark.parametrize("how", [copy.copy, copy.deepcopy, lambda simulator: pickle.loads(pickle.dumps(simulator))])
def test_a_copy_goes_on_as_what_is_restored(how: Callable[[Simulator], Simulator]):
    worlds = "cpu", 2, {"balloon.mass": [0.1, 0.3]}
    simulator = stepped(Simulator(BUSY, *worlds), 1)
    simulator.set({"gravity": 3.0})
    other = how(stepped(simulator, 1))
    expected = points(stepped(simulator, 2))
    assert other.frame_number == 2
    np.testing.assert_array_equal(points(stepped(other, 2)), expected)
    other.set({"balloon.mass": 2.0})
    simulator.reset()
    np.testing.assert_array_equal(points(stepped(simulator, 1)), points(stepped(Simulator(BUSY, *worlds), 1)))


def test_a_simulator_of_a_model_is_not_pickled():
    with pytest.raises(InputError, match=r"cannot be pickled; .*save\(\)"):
        pickle.dumps(Simulator.of_model(Simulator(BUSY, "cpu").model))


@pytest.mark.full
def test_what_is_saved_brings_back_what_was_set(device: str, tmp_path: Path):
    changes = [Change(time=SECONDS, set={"gravity": 3.0}), Change(time=4 * SECONDS, set={"gravity": 6.0})]
    scene = BUSY.model_copy(update={"change": changes})
    simulator = stepped(Simulator(scene, device, 2), 1)
    simulator.set({"balloon.mass": np.array([0.1, 0.3]), "contact": "impulse"})
    stepped(simulator, 1)
    np.savez(tmp_path / "here.npz", **simulator.save())
    assert simulator.save()["points"].shape == (2, 56, 3)
    expected = points(stepped(simulator, 4))
    for other in (simulator, Simulator(scene, device, 2)):
        with np.load(tmp_path / "here.npz") as saved:
            other.restore(saved)
        assert other.frame_number == 2
        np.testing.assert_array_equal(points(stepped(other, 4)), expected)
