"""Phases from outside the package are added by a line of the list: their rows are the scene's, and every schedule runs
them and keeps their state."""

import dataclasses
import re
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from block_layouts import LAYOUTS
from features import features
from meshes import quad_sphere
from method_scenes import with_phase
from own_phases import (
    age,
    attract,
    count_substeps,
    lead,
    list_after,
    release,
    scribble,
    slacken,
    slow,
    switch,
    travel,
    warm,
    weaken,
    weigh_spheres,
)
from trajectories import ROUNDING, after_frames, arrays, stepped

from balloon_warp import Balloon, Body, Change, Inflation, InputError, Obstacle, Scene, Simulator, Sphere
from balloon_warp.benchmarks.matrix import of_phase
from balloon_warp.kernels.schedules.launched import GATHERED
from balloon_warp.kernels.schedules.writer import cut
from balloon_warp.model import build_model, plan_model
from balloon_warp.scene.load import override_scene
from balloon_warp.schedules import block_layout
from balloon_warp.schedules.features import model_features

PAGE = Path(__file__).parent.parent / "docs" / "EXTENDING.md"
IMPORTS = """
from typing import Any

import warp as wp

from balloon_warp.kernels.laws import Parameter
from balloon_warp.kernels.phase import Look, phase
from balloon_warp.kernels.tables import Tables, sphere_number
from balloon_warp.kernels.features import Features
"""
SCENE = Scene(
    balloon=[Balloon(mesh=quad_sphere(3, 0.5), inflation=Inflation(k_normal=0.2))],
    sphere=[Sphere(position=(0.0, 9.0, 0.0)), Sphere(position=(0.0, 0.9, 0.0), radius=0.1)],
    gravity=0.0, substeps=12, frames=3, normals="cached", faces=False,
)  # fmt: skip
SLOWED = {"sphere.1.law.slow.slow_radius": 0.7, "sphere.1.law.slow.slowing": 40.0}
WARMED = {"balloon.law.warm.weakening": 2e-3, "balloon.law.warm.warming_seconds": 0.05, "atmosphere.temperature": 330.0}


@pytest.fixture
def listed(monkeypatch: pytest.MonkeyPatch) -> None:
    list_after(monkeypatch, "push", slow)
    list_after(monkeypatch, "pull", warm, weaken)


def scene_with(changes: dict[str, Any]) -> Scene:
    return override_scene(SCENE, list(changes.items()))


def simulated(changes: dict[str, Any], schedule: str, device: str, frames: int = 2, **more: Any) -> Simulator:
    return stepped(Simulator(scene_with(changes), device, schedule=schedule, **more), frames)


def temperatures(simulator: Simulator) -> np.ndarray:
    return simulator.state.kept["temperature"].numpy()


@pytest.mark.full
def test_a_sphere_slows_what_is_near(listed, schedule, device):
    one_step = {"frames_per_second": 200.0, "substeps": 1} | SLOWED
    rates = {"sphere.1.law.slow.slowing": 40.0}, {"sphere.1.law.slow.slowing": 0.0}
    simulators = [simulated(one_step | rate, schedule, device, 0) for rate in rates]
    shape = (*simulators[0].state.points.shape, 3)
    velocities = np.random.default_rng(1).uniform(-1.0, 1.0, shape).astype(np.float32)
    near = np.linalg.norm(simulators[0].state.points.numpy() - (0.0, 0.9, 0.0), axis=2) < 0.7
    for each in simulators:
        each.state.velocities.assign(velocities)
        each.step()
    found, expected = (each.state.velocities.numpy() for each in simulators)
    assert 0 < near.sum() < near.size
    np.testing.assert_allclose(found, expected / np.where(near, 1.2, 1.0)[..., None], atol=1e-6)


@pytest.mark.full
def test_temperatures_follow_the_air_s(listed, schedule, device):
    """Temperatures relax exponentially from substep to substep and frame to frame, by world."""
    air = np.array([330.0, 300.0, 280.0])
    simulator = simulated(WARMED, schedule, device, 2, world_count=3, vary={"atmosphere.temperature": air})
    left = (0.05 / (0.05 + simulator.model.step_seconds)) ** (2 * SCENE.substeps)
    found = temperatures(simulator)
    np.testing.assert_allclose(found, np.broadcast_to((air + (300.0 - air) * left)[:, None], found.shape), rtol=1e-5)


def test_the_phase_of_the_docs_goes_in_as_it_stands_there(monkeypatch, tmp_path, schedule, device):
    """The phase of the docs moves the kinetic energy that it takes into heat."""
    blocks = re.findall(r"^```python\n(.*?)^```", PAGE.read_text(encoding="utf-8"), re.DOTALL | re.MULTILINE)
    (code,) = (each for each in blocks if "keeps=" in each)
    (tmp_path / f"docs_{schedule}.py").write_text(f"{IMPORTS}\n{code}", encoding="utf-8")
    monkeypatch.syspath_prepend(tmp_path)
    list_after(monkeypatch, "push", import_module(f"docs_{schedule}").slow)
    simulator = simulated({"frames_per_second": 200.0, "substeps": 1} | SLOWED, schedule, device, 0)
    simulator.step()
    squared = (simulator.state.velocities.numpy() ** 2).sum(axis=-1)
    heat = simulator.state.kept["heat"].numpy()
    assert 0 < (heat > 0.0).sum() < heat.size
    np.testing.assert_allclose(heat, np.where(heat > 0.0, 0.5 * (1.2**2 - 1.0) * squared, 0.0), rtol=1e-5)


@pytest.mark.full
@pytest.mark.parametrize("layout", LAYOUTS)
def test_blocks_of_any_layout_keep_values(layout, listed, monkeypatch):
    layout_of, cells = LAYOUTS[layout]
    ball = SCENE.balloon[0].model_copy(update={"mesh": quad_sphere(cells, 0.5)})
    scene = override_scene(SCENE.model_copy(update={"balloon": [ball]}), list((WARMED | SLOWED).items()))
    expected = arrays(after_frames(scene, "gather", "cpu"))
    monkeypatch.setattr(block_layout, "layout_of", layout_of)
    found = arrays(after_frames(scene, "block", "cpu"))
    for name in ("points", "temperature"):
        np.testing.assert_allclose(found[name], expected[name], rtol=1e-6, atol=ROUNDING)


@pytest.mark.parametrize("phase", [slow, warm], ids=lambda phase: phase.name)
def test_a_phase_is_in_the_table_of_methods_and_in_scenes_of_every_schedule_because_it_is_listed(phase, listed):
    scenes = of_phase(phase).scene(), with_phase(phase)
    assert all(f"phase {phase.name}" in features(build_model(scene, "cpu")) for scene in scenes)


def test_a_phase_without_effect_is_left_out(listed):
    model = build_model(SCENE, "cpu")
    assert not features(model) & {"phase slow", "phase warm", "phase weaken"}
    assert Simulator.of_model(model).state.kept == {}


@pytest.mark.full
def test_what_is_kept_goes_on_bit_for_bit(listed, schedule, device):
    one = simulated(WARMED, schedule, device, 1)
    saved = one.save()
    other = simulated(WARMED, schedule, device, 0)
    other.restore(saved)
    for each in (one, other):
        each.step()
    for name, array in one.state.arrays.items():
        np.testing.assert_array_equal(array.numpy(), other.state.arrays[name].numpy(), err_msg=name)
    assert np.ptp(temperatures(one)) == 0.0
    one.reset()
    assert (temperatures(one) == 300.0).all()


@pytest.mark.full
def test_a_phase_may_begin_and_end_while_it_is_simulated(listed, device):
    simulator = simulated({}, "auto", device, 1)
    simulator.set(WARMED)
    simulator.step()
    warmer = temperatures(simulator)
    assert (warmer > 300.0).all()
    simulator.set({"balloon.mass": 0.2})
    np.testing.assert_array_equal(temperatures(simulator), warmer)
    simulator.set({"balloon.law.warm.weakening": 0.0})
    assert simulator.state.kept == {}
    planned = Change(time=1.0 / 24.0, set={"balloon.law.warm.weakening": 2e-3})
    changing = Simulator(SCENE.model_copy(update={"change": [planned]}), device)
    assert "temperature" in changing.state.kept
    changing.step()


@pytest.mark.full
def test_worlds_that_are_simulated_again_keep_what_they_had(listed, schedule, device):
    """Repeated frames do not warm twice, beside an obstacle so near that no frame is free."""
    beside = scene_with(WARMED).model_copy(update={"obstacle": [Obstacle(position=(0.0, -1.01, 0.0), size=(1, 1, 1))]})
    simulator = Simulator(beside, device, schedule=schedule)
    simulator.step()
    left = (0.05 / (0.05 + simulator.model.step_seconds)) ** SCENE.substeps
    np.testing.assert_allclose(temperatures(simulator), 330.0 - 30.0 * left, rtol=1e-5)


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"sphere.0.law.slow.slowing": -1.0}, r"sphere.0.law.slow.slowing: must be at least 0 \(got -1.0\)"),
        ({"sphere.0.law.slow.speed": 1.0}, "sphere.0.law.slow.speed: unknown field; known here are slow_radius"),
        ({"sphere.0.law.warm.weakening": 1.0}, "sphere.0.law.warm: unknown law; known"),
        ({"balloon.law.warm.warming_seconds": 0.0}, "balloon.0.law.warm.warming_seconds: must be at least 1e-06"),
    ],
)
def test_bad_values_of_rows_are_refused_in_a_sentence(changes, sentence, listed):
    with pytest.raises(InputError, match=sentence):
        plan_model(scene_with(changes))


def test_a_solver_that_does_not_have_a_phase_says_so(listed):
    with pytest.raises(InputError, match='solver: "projective" does not support the phase slow'):
        Simulator(scene_with(SLOWED | {"solver": "projective"}), "cpu")


def test_a_phase_that_lets_gas_out_makes_it_change(monkeypatch, schedule, device):
    """Amounts follow the implicit steps n / (1 + h r) while the valve is open, from the second substep on, though no
    pump, neck or leak says that the gas changes; the second balloon's stays shut."""
    list_after(monkeypatch, "pump", release)
    list_after(monkeypatch, "find_volume_rate", switch)
    gas = Inflation(kind="gas", start_pressure=400.0)
    balls = [Balloon(mesh=quad_sphere(4, 0.5), inflation=gas, position=(2.0 * number, 0.0, 0.0)) for number in range(2)]
    scene = Scene(balloon=balls, gravity=0.0, substeps=16, frames=4, touch=False)
    valves = [(f"balloon.{number}.law.switch.valve_volume", volume) for number, volume in enumerate((0.1, 10.0))]
    rates = np.array([6.0, 3.0])
    for some in (scene, scene.model_copy(update={"balloon": balls[:1]})):
        told = override_scene(some, valves[: len(some.balloon)]), {"balloon.law.switch.valve_rate": rates}
        simulator = Simulator(told[0], device, 2, told[1], schedule=schedule)
        before = simulator.state.gas_amounts.numpy().copy()
        stepped(simulator, scene.frames)
        left = (1.0 + rates * simulator.model.step_seconds) ** -(scene.frames * 16.0 - 1.0)
        found = simulator.state.gas_amounts.numpy() / before
        np.testing.assert_allclose(found, np.stack([left, np.ones(2)], axis=1)[:, : len(some.balloon)], rtol=1e-5)
        np.testing.assert_array_equal(simulator.state.kept["opened"].numpy(), [[1.0, 0.0][: len(some.balloon)]] * 2)
        expected = stepped(Simulator(told[0], device, 2, told[1], schedule="gather"), scene.frames)
        np.testing.assert_allclose(simulator.state.points.numpy(), expected.state.points.numpy(), atol=2e-6)


def test_old_skin_is_weak_at_both_ends_of_a_spring(monkeypatch, schedule, device):
    """Forces by what both ends keep add up to nothing, and schedules agree: a stretched ball relaxes less, once its age
    passes the limit."""
    list_after(monkeypatch, "pull", age, slacken)
    large = quad_sphere(3, 0.5)
    skin = Balloon(mesh=large, inflation=Inflation(pressure=20.0), mass=0.2, damping=0.5)
    scene = Scene(balloon=[skin], gravity=0.0, substeps=16, frames=8)

    def after(limit: float, schedule: str) -> Simulator:
        told = override_scene(scene, [("balloon.law.age.skin_limit", limit)])
        return stepped(Simulator(told, device, schedule=schedule), scene.frames)

    old, peer, young = after(1e-3, schedule), after(1e-3, "gather"), after(10.0, schedule)
    ages = old.state.kept["skin_age"].numpy()
    assert ages.min() > 1e-3
    np.testing.assert_allclose(ages, peer.state.kept["skin_age"].numpy(), rtol=1e-4)
    np.testing.assert_allclose(old.state.points.numpy(), peer.state.points.numpy(), atol=3e-6)
    assert np.linalg.norm(old.state.velocities.numpy().mean(axis=1)) < 1e-5
    assert old.read_frame().volumes[0] > 1.05 * young.read_frame().volumes[0]


def test_spheres_and_worlds_keep_values(monkeypatch, schedule, device):
    list_after(monkeypatch, "roll", travel, count_substeps)
    sphere = Sphere(position=(0.0, 9.0, 0.0), radius=0.1, velocity=(0.0, 0.0, 2.0))
    scene = override_scene(SCENE.model_copy(update={"sphere": [sphere] * 2}), [("sphere.1.law.travel.odometer", 1.0)])
    simulator = stepped(Simulator(scene, device, 2, schedule=schedule), 2)
    told = 2.0 * 2.0 / scene.frames_per_second
    np.testing.assert_allclose(simulator.state.kept["traveled"].numpy(), [[0.0, told]] * 2, rtol=1e-6)
    np.testing.assert_array_equal(simulator.state.kept["passed"].numpy(), [[2.0 * 12.0]] * 2)


@pytest.mark.parametrize("contact", ["penalty", "impulse"])
def test_a_phase_pushes_spheres_whatever_their_contact(contact, monkeypatch, schedule, device):
    """Spheres and the balloon that they attract conserve momentum, also while a sphere hits it and exchanges some."""
    list_after(monkeypatch, "take", attract)
    rest = Balloon(mesh=quad_sphere(4, 0.5), inflation=Inflation(k_normal=0.0), damping=0.0)
    hits = {"position": (0.0, 0.9, 0.0), "velocity": (0.0, -8.0, 0.0)} if contact == "impulse" else {}
    struck = Sphere(**{"position": (0.0, 1.5, 0.0), "mass": 0.5, "radius": 0.3} | hits)
    spheres = [struck, Sphere(position=(1.2, 0.3, 0.0), radius=0.1)]
    scene = Scene(balloon=[rest], sphere=spheres, gravity=0.0, substeps=16, frames=4, faces=False, contact=contact)
    scene = override_scene(scene, [(f"sphere.{number}.law.attract.magnet", 1.0 + number) for number in range(2)])
    simulator, touched = Simulator(scene, device, schedule=schedule), False
    for _ in range(scene.frames):
        simulator.step()
        touched |= contact == "impulse" and bool(simulator.state.sphere_forces.numpy().any())
    assert touched == (contact == "impulse")
    state = simulator.state
    share = 1.0 / state.points.shape[1]
    own = state.velocities.numpy()[0].astype(float).sum(axis=0) * share * rest.mass
    masses = np.array([[each.mass] for each in scene.sphere])
    theirs = (masses * state.sphere_velocities.numpy()[0]).sum(axis=0)
    if contact == "penalty":  # which acts as the next substep begins
        theirs += state.sphere_forces.numpy()[0].sum(axis=0) / (scene.frames_per_second * 16.0)
    assert np.linalg.norm(own) > 5e-3
    before = (masses * [each.velocity for each in scene.sphere]).sum(axis=0)
    np.testing.assert_allclose(own + theirs, before, atol=1e-6 * max(1.0, np.linalg.norm(before)))


def test_a_phase_pushes_a_body(monkeypatch, schedule, device):
    """A body and a balloon that pull each other keep their momentum, and come together as two masses on a spring:
    x' = -r w sin(w t), w^2 = k / M + k / m, within the 3 % of its first order in w h."""
    list_after(monkeypatch, "take", lead)
    rest = Balloon(mesh=quad_sphere(4, 0.5), inflation=Inflation(k_normal=0.0), damping=0.0, mass=0.5)
    body = Body(shape="box", size=(0.2, 0.2, 0.2), mass=0.4, position=(3.0, 0.0, 0.0))
    scene = Scene(balloon=[rest], body=[body], gravity=0.0, substeps=16, frames=12, touch=False)
    simulator = Simulator(override_scene(scene, [("balloon.law.lead.leash", 4.0)]), device, schedule=schedule)
    state = stepped(simulator, scene.frames).state
    pace, time = np.sqrt(4.0 / 0.5 + 4.0 / 0.4), scene.frames / scene.frames_per_second
    told = 3.0 * 0.5 * 0.4 / 0.9 * pace * np.sin(pace * time)  # momentum
    own = 0.5 * state.velocities.numpy()[0].astype(float).mean(axis=0)
    theirs = 0.4 * state.body_velocities.numpy()[0, 0].astype(float)
    np.testing.assert_allclose(own + theirs, 0.0, atol=1e-6)
    np.testing.assert_allclose(own, [told, 0.0, 0.0], rtol=0.03, atol=1e-5)
    np.testing.assert_allclose(state.body_momenta.numpy(), 0.0, atol=1e-5)


def test_a_phase_that_writes_what_has_no_name_is_refused(monkeypatch, device):
    list_after(monkeypatch, "pull", scribble)
    scene = Scene(balloon=[Balloon(mesh=quad_sphere(2), inflation=Inflation(k_normal=0.2))], gravity=0.0)
    with pytest.raises(TypeError, match=r"^phase scribble: writes `springs.valences`, which has no name; expected"):
        Simulator(scene, device)


def test_a_barrier_stands_before_who_reads_what_others_have_got(monkeypatch):
    """A phase that reads sums on spheres waits for all particles that add to them; one that does not goes on."""
    list_after(monkeypatch, "take", attract, weigh_spheres, slow)
    features = model_features(build_model(SCENE, "cpu"))
    pieces = [cut([attract, each], features, GATHERED).pieces for each in (weigh_spheres, slow)]
    assert [[phase.name for phase in piece.phases] for piece in pieces[0]] == [["attract"], ["weigh_spheres"]]
    assert [[phase.name for phase in piece.phases] for piece in pieces[1]] == [["attract", "slow"]]


def test_a_phase_named_like_a_value_is_refused(listed):
    twin = dataclasses.replace(slow, name="velocity")
    with pytest.raises(TypeError, match="the phase velocity is named like what another reads; expected a name of its"):
        cut([slow, twin], model_features(build_model(SCENE, "cpu")), GATHERED)
