"""Phases from outside the package, by a line of the list; and lists of phases without any physics, against NumPy."""

import dataclasses
import re
from collections.abc import Sequence
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import own_phases
import pytest
import warp as wp
from block_layouts import LAYOUTS
from feature_sets import feature_set
from meshes import cube, quad_sphere
from method_scenes import features, with_phase
from trajectories import ROUNDING, after_frames, arrays, stepped

from balloon_warp import Balloon, Body, Change, Inflation, InputError, Obstacle, Scene, Simulator, Sphere, load_scene
from balloon_warp.benchmarks.matrix import of_phase
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.phase import Phase
from balloon_warp.kernels.schedules.lanes import ACCESS
from balloon_warp.kernels.schedules.launched import GATHERED, source_of
from balloon_warp.kernels.schedules.writer import Step, cut
from balloon_warp.kernels.substep import STEP
from balloon_warp.model import Model, State, build_model, initial_state, plan_model
from balloon_warp.model.state import Allocating
from balloon_warp.scene.load import override_scene
from balloon_warp.schedules import layouts
from balloon_warp.schedules.launched import Launches
from balloon_warp.schedules.one_launch import LanesSchedule, OctetsSchedule
from balloon_warp.schedules.tables import make_tables, model_features
from balloon_warp.tools.doctor import kernel_source

PAGE = Path(__file__).parent.parent / "docs" / "EXTENDING.md"
IMPORTS = """
from typing import Any

import warp as wp

from balloon_warp.kernels.laws import Parameter
from balloon_warp.kernels.phase import Access, phase
from balloon_warp.kernels.tables import Tables, sphere_number
from balloon_warp.kernels.features import Features
"""
SCENE = Scene(
    balloon=[Balloon(mesh=quad_sphere(3, 0.5), inflation=Inflation(k_normal=0.2))],
    sphere=[Sphere(position=(0.0, 9.0, 0.0)), Sphere(position=(0.0, 0.9, 0.0), radius=0.1)],
    gravity=0.0, substeps=12, frames=3, normals="cached", faces=False,
)  # fmt: skip
SLOWED = {"sphere.1.law.slow.slow_radius": 0.7, "sphere.1.law.slow.slowing": 40.0}
KEEPS = SLOWED | {"sphere.1.law.travel.odometer": 1.0}
WARMED = {"balloon.law.warm.weakening": 2e-3, "balloon.law.warm.warming_seconds": 0.05, "atmosphere.temperature": 330.0}


@pytest.fixture
def listed(monkeypatch: pytest.MonkeyPatch) -> None:
    own_phases.list_after(monkeypatch, "push", own_phases.slow)
    own_phases.list_after(monkeypatch, "pull", own_phases.warm, own_phases.weaken)


def scene_with(changes: dict[str, Any]) -> Scene:
    return override_scene(SCENE, list(changes.items()))


def simulated(changes: dict[str, Any], schedule: str, device: str, frames: int = 2, **more: Any) -> Simulator:
    return stepped(Simulator(scene_with(changes), device, schedule=schedule, **more), frames)


def temperatures(simulator: Simulator) -> np.ndarray:
    return simulator.state.kept["temperature"].numpy()


BESIDE = Obstacle(position=(0.0, -1.01, 0.0), size=(1.0, 1.0, 1.0))
"""So near that no frame is free"""


@pytest.mark.full
@pytest.mark.parametrize("obstacles", [[], [BESIDE]], ids=["alone", "in frames that are repeated"])
def test_temperatures_follow_the_air_s_once_a_substep(obstacles, listed, schedule, device):
    air = np.array([330.0, 300.0, 280.0])
    scene = scene_with(WARMED).model_copy(update={"obstacle": obstacles})
    simulator = Simulator(scene, device, 3, {"atmosphere.temperature": air}, schedule)
    stepped(simulator, 2)
    left = (0.05 / (0.05 + simulator.model.step_seconds)) ** (2 * SCENE.substeps)
    found = temperatures(simulator)
    np.testing.assert_allclose(found, np.broadcast_to((air + (300.0 - air) * left)[:, None], found.shape), rtol=1e-5)


@pytest.fixture
def kept(monkeypatch: pytest.MonkeyPatch, tmp_path: Path, schedule: str) -> None:
    """List the phase of the docs as it stands there, and two that keep values of spheres and worlds."""
    blocks = re.findall(r"^```python\n(.*?)^```", PAGE.read_text(encoding="utf-8"), re.DOTALL | re.MULTILINE)
    (code,) = (each for each in blocks if "keeps=" in each)
    (tmp_path / f"docs_{schedule}.py").write_text(f"{IMPORTS}\n{code}", encoding="utf-8")
    monkeypatch.syspath_prepend(tmp_path)
    own_phases.list_after(monkeypatch, "push", import_module(f"docs_{schedule}").slow)
    own_phases.list_after(monkeypatch, "roll", own_phases.travel, own_phases.count_substeps)


def test_the_phase_of_the_docs_moves_the_energy_that_it_takes_into_heat(kept, schedule, device):
    simulator = simulated({"frames_per_second": 200.0, "substeps": 1} | KEEPS, schedule, device, 0)
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
    monkeypatch.setattr(layouts, "layout_of", layout_of)
    found = arrays(after_frames(scene, "block", "cpu"))
    for name in ("points", "temperature"):
        np.testing.assert_allclose(found[name], expected[name], rtol=1e-6, atol=ROUNDING)


@pytest.mark.parametrize("phase", [own_phases.slow, own_phases.warm], ids=lambda phase: phase.name)
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


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"sphere.0.law.slow.slowing": -1.0}, r"sphere.0.law.slow.slowing: must be at least 0 \(got -1.0\)"),
        ({"sphere.0.law.warm.weakening": 1.0}, "sphere.0.law.warm: unknown law; known"),
    ],
)
def test_bad_values_of_rows_are_refused_in_a_sentence(changes, sentence, listed):
    with pytest.raises(InputError, match=sentence):
        plan_model(scene_with(changes))


def test_a_solver_that_does_not_have_a_phase_says_so(listed):
    with pytest.raises(InputError, match='solver: "projective" does not support the phase slow'):
        Simulator(scene_with(SLOWED | {"solver": "projective"}), "cpu")


@pytest.mark.parametrize("count", [2, pytest.param(1, marks=pytest.mark.full)])
def test_a_phase_that_lets_gas_out_makes_it_change(count, monkeypatch, schedule, device):
    """Amounts follow the implicit steps n / (1 + h r) while the valve is open, from the second substep on, though no
    pump, neck or leak says that the gas changes; the second balloon's stays shut."""
    own_phases.list_after(monkeypatch, "pump", own_phases.release)
    own_phases.list_after(monkeypatch, "find_volume_rate", own_phases.switch)
    gas = Inflation(kind="gas", start_pressure=400.0)
    balls = [Balloon(mesh=quad_sphere(4, 0.5), inflation=gas, position=(2.0 * n, 0.0, 0.0)) for n in range(count)]
    scene = Scene(balloon=balls, gravity=0.0, substeps=16, frames=4, touch=False)
    scene = override_scene(scene, [(f"balloon.{n}.law.switch.valve_volume", (0.1, 10.0)[n]) for n in range(count)])
    rates = np.array([6.0, 3.0])
    vary = {"balloon.law.switch.valve_rate": rates}
    simulator = Simulator(scene, device, 2, vary, schedule=schedule)
    before = simulator.state.gas_amounts.numpy().copy()
    stepped(simulator, scene.frames)
    left = (1.0 + rates * simulator.model.step_seconds) ** -(scene.frames * 16.0 - 1.0)
    found = simulator.state.gas_amounts.numpy() / before
    np.testing.assert_allclose(found, np.stack([left, np.ones(2)], axis=1)[:, :count], rtol=1e-5)
    np.testing.assert_array_equal(simulator.state.kept["opened"].numpy(), [[1.0, 0.0][:count]] * 2)
    own = "octets" if device == "cpu" else "block"
    expected = stepped(Simulator(scene, device, 2, vary, schedule=own), scene.frames)
    np.testing.assert_allclose(simulator.state.points.numpy(), expected.state.points.numpy(), atol=2e-6)


def test_old_skin_is_weak_at_both_ends_of_a_spring(monkeypatch, schedule, device):
    """Forces by what both ends keep add up to nothing, and schedules agree: a stretched ball relaxes less, once its age
    passes the limit."""
    own_phases.list_after(monkeypatch, "pull", own_phases.age, own_phases.slacken)
    large = quad_sphere(3, 0.5)
    skin = Balloon(mesh=large, inflation=Inflation(pressure=20.0), mass=0.2, damping=0.5)
    scene = Scene(balloon=[skin], gravity=0.0, substeps=16, frames=8)

    def after(limit: float, schedule: str) -> Simulator:
        told = override_scene(scene, [("balloon.law.age.skin_limit", limit)])
        return stepped(Simulator(told, device, schedule=schedule), scene.frames)

    old, peer, young = after(1e-3, schedule), after(1e-3, "auto"), after(10.0, schedule)
    ages = old.state.kept["skin_age"].numpy()
    assert ages.min() > 1e-3
    np.testing.assert_allclose(ages, peer.state.kept["skin_age"].numpy(), rtol=1e-4)
    np.testing.assert_allclose(old.state.points.numpy(), peer.state.points.numpy(), atol=3e-6)
    assert np.linalg.norm(old.state.velocities.numpy().mean(axis=1)) < 1e-5
    assert old.read_frame().volumes[0] > 1.05 * young.read_frame().volumes[0]


def test_spheres_and_worlds_keep_values(kept, schedule, device):
    sphere = Sphere(position=(0.0, 9.0, 0.0), radius=0.1, velocity=(0.0, 0.0, 2.0))
    scene = override_scene(SCENE.model_copy(update={"sphere": [sphere] * 2}), list(KEEPS.items()))
    simulator = stepped(Simulator(scene, device, 2, schedule=schedule), 2)
    told = 2.0 * 2.0 / scene.frames_per_second
    np.testing.assert_allclose(simulator.state.kept["traveled"].numpy(), [[0.0, told]] * 2, rtol=1e-6)
    np.testing.assert_array_equal(simulator.state.kept["passed"].numpy(), [[2.0 * 12.0]] * 2)


@pytest.mark.parametrize("contact", [pytest.param("penalty", marks=pytest.mark.full), "impulse"])
def test_a_phase_pushes_spheres_whatever_their_contact(contact, monkeypatch, schedule, device):
    """Spheres and the balloon that they attract conserve momentum, also while a sphere hits it and exchanges some."""
    own_phases.list_after(monkeypatch, "take", own_phases.attract)
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


@pytest.mark.full
@pytest.mark.full
def test_a_phase_pushes_a_body(monkeypatch, schedule, device):
    """A body and a balloon that pull each other keep their momentum, and come together as two masses on a spring:
    x' = -r w sin(w t), w^2 = k / M + k / m, within the 3 % of its first order in w h."""
    own_phases.list_after(monkeypatch, "take", own_phases.lead)
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
    own_phases.list_after(monkeypatch, "pull", own_phases.scribble)
    scene = Scene(balloon=[Balloon(mesh=quad_sphere(2), inflation=Inflation(k_normal=0.2))], gravity=0.0)
    with pytest.raises(TypeError, match=r"^phase scribble: writes `springs.valences`, which has no name; expected"):
        Simulator(scene, device)


def test_a_barrier_stands_before_who_reads_what_others_have_got(monkeypatch):
    """A phase that reads sums on spheres waits for all particles that add to them; one that does not goes on."""
    own_phases.list_after(monkeypatch, "take", own_phases.attract, own_phases.weigh_spheres, own_phases.slow)
    features = model_features(build_model(SCENE, "cpu"))
    pieces = [
        cut([own_phases.attract, each], features, GATHERED).pieces
        for each in (own_phases.weigh_spheres, own_phases.slow)
    ]
    assert [[phase.name for phase in piece.phases] for piece in pieces[0]] == [["attract"], ["weigh_spheres"]]
    assert [[phase.name for phase in piece.phases] for piece in pieces[1]] == [["attract", "slow"]]


def test_a_phase_named_like_a_value_is_refused(listed):
    twin = dataclasses.replace(own_phases.slow, name="velocity")
    with pytest.raises(TypeError, match="the phase velocity is named like what another reads; expected a name of its"):
        cut([own_phases.slow, twin], model_features(build_model(SCENE, "cpu")), GATHERED)


DOCS = Path(__file__).parent.parent / "docs"


@pytest.fixture(scope="module", params=["small", "large"])
def model(request: pytest.FixtureRequest) -> Model:
    """Return balloons of 26 and 8 particles, or one so large that it is summed in parts."""
    meshes = [quad_sphere(2), cube()] if request.param == "small" else [cube(), quad_sphere(19)]
    return build_model(Scene(balloon=[Balloon(mesh=mesh) for mesh in meshes], touch=False), "cpu", 3)


def at_random(model: Model) -> tuple[State, own_phases.Values]:
    """Return a random state of worlds that differ, and its values."""
    rng = np.random.default_rng(2)
    shape = (model.world_count, model.particle_count, 3)
    have: own_phases.Values = {name: rng.uniform(-1.0, 1.0, shape).astype(np.float32) for name in ("point", "velocity")}
    state = initial_state(model)
    state.points, state.velocities = (wp.array(each, dtype=wp.vec3, device="cpu") for each in have.values())
    have |= {"trace": np.full(shape[:2], 1.0), "height": np.full((shape[0], model.face_count), 2.0)}
    state.kept = {name: wp.array(have[name], dtype=wp.float32, device="cpu") for name in ("trace", "height")}
    return state, {name: each.astype(np.float64) for name, each in have.items()}


def features_of(model: Model) -> Features:
    """Return features of a model with state for these phases."""
    return model_features(model)._replace(keeps=tuple(kept for each in own_phases.KEEPING for kept in each.kept))


def assert_done(
    phases: Sequence[Phase], model: Model, have: own_phases.Values, now: Sequence[wp.array], kept: dict[str, wp.array]
) -> None:
    """Require the result of three substeps of the phases."""
    first = model.face_particles.numpy()[model.face_offsets.numpy()[:-1]]
    for _ in range(3):
        for each in phases:
            if not each.light:
                own_phases.by_numpy(each.name, have, np.asarray(model.particle_offsets), first)
    for found, name in zip((*now, *kept.values()), ("point", "velocity", *kept), strict=True):
        size = np.abs(have[name]).max()
        np.testing.assert_allclose(found.numpy(), have[name], atol=4e-6 * size)  # float32, sums of thousands among them


@pytest.mark.full
@pytest.mark.parametrize("doubles", [True, False], ids=["two places", "barriers"])
@pytest.mark.parametrize("phases", own_phases.LISTS, ids=lambda phases: " ".join(each.name for each in phases))
def test_a_list_does_what_its_phases_do_one_after_the_other(phases, doubles, model):
    features = features_of(model)
    step = cut(phases, features, GATHERED, doubles=doubles)
    assert doubles or not step.doubled
    state, have = at_random(model)
    launches, now = Launches(model, step, make_tables(model, features), Allocating(model.device)), None
    for substep in range(3):
        now = launches.substep(state, substep, now or (state.points, state.velocities))
    assert now is not None
    assert_done(phases, model, have, now, state.kept)


@pytest.mark.full
@pytest.mark.parametrize("schedule", [LanesSchedule, OctetsSchedule], ids=["lanes", "octets"])
@pytest.mark.parametrize("phases", own_phases.LISTS, ids=lambda phases: " ".join(each.name for each in phases))
def test_eight_side_by_side_do_the_same(phases, schedule, model):

    class OfPhases(schedule):
        @classmethod
        def step_of(cls, features: Features) -> Step:
            return cut(phases, features_of(model), ACCESS[cls.layout], sums_along=True)

    state, have = at_random(model)
    of_phases = OfPhases(model)
    of_phases.tables.substeps = 3
    of_phases.advance_frame(state)
    assert_done(phases, model, have, (state.points, state.velocities), state.kept)


def test_what_nothing_writes_is_refused_by_name(model):
    with pytest.raises(TypeError, match="a phase reads seen, which nothing before it writes"):
        source_of(cut((own_phases.follow,), model_features(model), GATHERED))


def test_a_phase_that_looks_at_what_others_have_moved_waits_for_them(model):
    def names(phases: Sequence[Phase], **how: Any) -> list[list[str]]:
        step = cut(phases, model_features(model), GATHERED, **how)
        return [[each.name for each in piece.phases] for piece in step.pieces]

    assert names((own_phases.look_aside, own_phases.follow)) == [["look_aside", "follow"]]
    assert names((own_phases.look_aside, own_phases.follow), doubles=False) == [["look_aside"], ["follow"]]
    assert names((own_phases.trade, own_phases.look_aside, own_phases.follow)) == [["trade"], ["look_aside", "follow"]]
    assert names((own_phases.look_aside, own_phases.follow), apart=("follow",)) == [["look_aside"], ["follow"]]
    assert names((own_phases.add, own_phases.halve, own_phases.double, own_phases.heed)) == [["add", "halve"], ["heed"]]


def code_blocks(page: Path) -> list[str]:
    """Return the blocks of Python on a page of the docs."""
    return re.findall(r"^```python\n(.*?)^```", page.read_text(encoding="utf-8"), re.S | re.M)


def test_the_source_in_the_docs_is_the_one_that_is_printed():
    for begins, scene, schedule in (
        ("def particles_inflate_to_leave(", "latex_inflate", "gather"),
        ("        for particle in", "squirrel_tether", "block"),
    ):
        (shown,) = (text for text in code_blocks(DOCS / "ARCHITECTURE.md") if text.startswith(begins))
        assert shown in kernel_source(load_scene(scene), schedule)


def test_a_source_has_its_phases_in_the_order_of_the_list():
    for schedule in ("gather", "scatter", "block", "lanes", "octets"):
        printed = kernel_source(feature_set("all"), schedule)
        called = [each.name for each in STEP if not each.light and re.search(rf"\b{each.name}\(", printed)]
        assert len(called) > 10
        places = [re.search(rf"\b{name}\(", printed) for name in called]
        assert [place.start() for place in places if place] == sorted(place.start() for place in places if place)
