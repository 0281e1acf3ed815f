"""Laws of one's own and the list's: messages, parameters, work in simulators and batches, and each one's step."""

import json
import pickle
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import warp as wp
from meshes import cube
from numpy.typing import NDArray
from own_laws import AT_THE_END, HARDENING, MAGNET, TESTED, magnet, model_of_all, particle_masses, shake, stable_step
from trajectories import stepped

import balloon_warp as bw
from balloon_warp.frame import ForceReader
from balloon_warp.kernels.algebra import inverse_root
from balloon_warp.kernels.laws import LAWS, Law
from balloon_warp.laws import require_laws
from balloon_warp.mesh.obj import write_obj
from balloon_warp.model import build_model, initial_state, plan_model
from balloon_warp.model.parameters import active_laws
from balloon_warp.scene import Balloon, Change, Inflation, Scene, Stiffness
from balloon_warp.scene.load import override_scene, scene_toml
from balloon_warp.schedules.gather import GatherSchedule
from balloon_warp.studio.page.controls import VALUES, values_of
from balloon_warp.studio.page.playground import Playground

STRENGTH = bw.Parameter("strength", "1", 1.0)
law = bw.particle_law
magnetic = partial(law, magnet, MAGNET.parameters)


@wp.func
def lost(position: wp.vec3, distance: float):
    return distance * position


@wp.func
def of_whole_numbers(position: wp.vec3, strength: int):
    return float(strength) * position


@wp.func
def misspelt(position: wp.vec3):
    return wp.lenght(position) * position


@wp.func
def silent(position: wp.vec3):
    twice = 2.0 * position  # noqa: F841


@wp.func
def native(squared_length: float):
    return inverse_root(squared_length)


@wp.func
def by_a_choice(position: wp.vec3):
    return wp.where(position[0] > 0.0, position, inverse_root(2.0) * position)


@wp.func
def a_number(position: wp.vec3, strength: float):
    return strength * wp.length(position)


def plain(position: wp.vec3):
    return position


def scene(**fields) -> Scene:
    return Scene(**{"balloon": [Balloon(mesh=cube()), Balloon(mesh=cube(), position=(3.0, 0.0, 0.0))], **fields})


@pytest.mark.parametrize(
    ("make", "sentence"),
    [
        (lambda: law(plain), r"^particle law: expected a function with @wp\.func before it \(got <function"),
        (lambda: law(lost), r"^law lost: unknown argument distance; expected some of position, velocity, .*time$"),
        (lambda: law(of_whole_numbers, [STRENGTH]), r"its argument strength is of another type; expected float$"),
        (lambda: law(a_number, [STRENGTH]), r"^law a_number: returns a float; expected a vec3f$"),
        (lambda: law(misspelt), r"^law misspelt: cannot be called: module 'warp' has no .* 'lenght'$"),
        (lambda: law(silent), r"^law silent: returns nothing; expected a return with a value$"),
        (lambda: law(magnet, energy=plain), r"^law magnet: unknown argument strength"),
        (
            lambda: magnetic(stiffness=lambda height: height),
            r"^law magnet: its stiffness takes height; expected mass, ",
        ),
        (lambda: magnetic(neutral={"weakness": 0.0}), r"^law magnet: neutral names weakness; expected one of its par"),
        (lambda: magnetic(color="red"), r"^law magnet: .* argument 'color'$"),
        (
            lambda: law(a_number, [bw.Parameter("strength", "1", of="sphere")]),
            r'^law a_number: its parameter strength is of="sphere"; expected "balloon" or "world"$',
        ),
        (
            lambda: law(a_number, [bw.Parameter("strength", "1", path="mass")]),
            r"^law a_number: its parameter strength is at mass; expected law\.NAME\.PARAMETER, or no path$",
        ),
        (lambda: magnetic(energy=magnet), r"^law magnet: its energy: returns a vec3f; expected a float$"),
    ],
)
def test_a_bad_law_gets_one_sentence(make, sentence):
    with pytest.raises(bw.InputError, match=sentence):
        make()


def test_what_only_kernels_have_is_no_mistake():
    assert bw.spring_law(native).name == "native"
    assert bw.particle_law(by_a_choice).force is by_a_choice


@pytest.mark.parametrize(
    ("laws", "sentence"),
    [
        ([MAGNET, MAGNET], "^law magnet: another law has this name"),
        (
            [MAGNET, law(magnet, MAGNET.parameters[1:] + (STRENGTH,), name="other")],
            "^law other: its parameter strength is also a parameter of law magnet, with another definition",
        ),
        (
            [law(magnet, [*MAGNET.parameters, bw.Parameter("helium", "1")])],
            "^law magnet: its parameter helium is also a parameter of a built-in law, with another definition",
        ),
        ([magnet], r"^laws: expected a Law \(got"),
    ],
)
def test_laws_that_do_not_go_together_are_refused(laws, sentence):
    with pytest.raises(bw.InputError, match=sentence):
        require_laws(laws)
    require_laws([MAGNET, magnetic(name="second")])  # which share a row


def test_parameters_stand_in_the_law_s_table():
    said = override_scene(scene(), [("balloon.1.law.magnet.strength", 5.0), ("law.magnet.pole", [0.0, 1.0, 2.0])])
    model = build_model(said, "cpu", laws=[MAGNET])
    assert model.own_laws == (MAGNET,)
    np.testing.assert_array_equal(model.parameters["strength"].numpy(), [[2.0, 5.0]])
    np.testing.assert_array_equal(model.parameters["pole"].numpy(), [[0.0, 1.0, 2.0]])
    assert "law = { magnet = { strength = 5.0 } }" in scene_toml(said, Path())


@pytest.mark.parametrize(
    ("path", "value", "sentence"),
    [
        ("balloon.law.magnet.strength", -1.0, r"^balloon\.0\.law\.magnet\.strength: must be at least 0 \(got -1\.0\)$"),
        ("law.magnet.pole", 1.0, r"^law\.magnet\.pole: must be 3 numbers \(got 1\.0\)$"),
        ("balloon.law.magnet.force", 1.0, r"^balloon\.0\.law\.magnet\.force: unknown field; known here are strength$"),
        ("law.hardening.hardness", 1.0, r"^law\.hardening: unknown law; known here are magnet"),
    ],
)
def test_values_that_do_not_fit_are_refused(path, value, sentence):
    with pytest.raises(bw.InputError, match=sentence):
        plan_model(override_scene(scene(), [(path, value)]), laws=[MAGNET, HARDENING])
    with pytest.raises(bw.InputError, match=r"^balloon\.0\.law\.magnet: unknown law; no given law has"):
        plan_model(override_scene(scene(), [("balloon.law.magnet.strength", 1.0)]))


def test_parameters_differ_between_worlds():
    vary = {"balloon.law.magnet.strength": [1.0, 2.0, 3.0], "law.magnet.pole.1": [0.5, 0.0, -0.5]}
    model = build_model(scene(), "cpu", 3, vary, [MAGNET])
    np.testing.assert_array_equal(model.parameters["strength"].numpy(), [[1.0, 1.0], [2.0, 2.0], [3.0, 3.0]])
    np.testing.assert_array_equal(model.parameters["pole"].numpy()[:, 1], [0.5, 0.0, -0.5])
    with pytest.raises(bw.InputError, match=r"^balloon\.0\.law\.magnet\.strength: must be at least 0 .* in world 1$"):
        plan_model(scene(), 2, {"balloon.law.magnet.strength": [1.0, -2.0]}, laws=[MAGNET])


def test_bounds_count_in_the_step():
    """The step includes a law's bounds: each particle of a slack balloon on a magnet has omega^2 the strength."""
    slack = Stiffness(structural=0.0, shear=0.0, flexion=0.0)
    loose = scene(balloon=[Balloon(mesh=cube(), stiffness=slack, damping=0.0)])
    pulled = override_scene(loose, [("balloon.law.magnet.strength", 1.0e6)])
    assert bw.advise_step(pulled, [MAGNET]).stable_step == pytest.approx(2.0e-3)
    apart = scene(touch=False)
    hardened = override_scene(apart, [("balloon.law.hardening.hardness", 8.0 / 3.0)])
    soft, hard = bw.advise_step(apart, [HARDENING]), bw.advise_step(hardened, [HARDENING])
    assert hard.stable_step < 0.55 * soft.stable_step  # four times the constant
    assert soft == bw.advise_step(apart)
    assert bw.advise_step(apart, [magnetic(name="unbound")]) == soft
    later = Change(time=0.5, set={"balloon.law.magnet.strength": 1.0e8})
    assert plan_model(scene(change=[later]), laws=[MAGNET]).substeps > 10 * plan_model(scene(), laws=[MAGNET]).substeps
    wrong = scene(change=[Change(time=0.5, set={"balloon.0.law.magnet.strength": -7.0})])
    with pytest.raises(bw.InputError, match=r"must be at least 0 \(got -7"):
        plan_model(wrong, laws=[MAGNET])


def test_what_is_neutral_or_not_wanted_does_not_act():
    def active(**overrides: float) -> list[str]:
        said = override_scene(scene(), [(f"balloon.{path.replace('__', '.')}", v) for path, v in overrides.items()])
        return [law.name for law in active_laws(plan_model(said, laws=[MAGNET, HARDENING]))]

    assert active(damping=0.0) == ["weight", "hooke", "magnet"]
    assert active(law__magnet__strength=0.0, stiffness__viscosity=0.1) == ["weight", "damping", "hooke", "rubber"]
    assert "hardening" in active(law__hardening__hardness=1.0)


def test_a_law_that_changes_from_neutral_has_its_kernels_from_the_start():
    later = scene(change=[Change(time=0.5, set={"balloon.0.law.hardening.hardness": 1.0})])
    assert HARDENING in active_laws(plan_model(later, laws=[MAGNET, HARDENING]))
    assert HARDENING in active_laws(build_model(later, "cpu", laws=[MAGNET, HARDENING]))


def test_a_law_travels_as_its_global_name():
    assert pickle.loads(pickle.dumps(MAGNET)) is MAGNET
    assert all(pickle.loads(pickle.dumps(law)) is law for law in LAWS)
    plan = pickle.loads(pickle.dumps(plan_model(scene(), laws=[MAGNET])))
    assert plan.laws == (*LAWS, MAGNET)
    nowhere = r"^law magnet: other processes cannot find it; expected a global name"
    with pytest.raises(pickle.PicklingError, match=nowhere):
        pickle.dumps(magnetic())


def test_numbers_have_sliders_and_vectors_do_not():
    (slider,) = values_of([MAGNET, *LAWS])
    said = override_scene(scene(), [("balloon.0.law.magnet.strength", 5.0)])
    assert (slider.path, slider.read(scene()), slider.read(said)) == ("balloon.law.magnet.strength", 2.0, 5.0)
    assert (slider.label, slider.least_reach, slider.signed) == ("strength [1/s^2]", 10.0, False)
    assert [value.path for value in VALUES][:2] == ["gravity", "balloon.helium"]


SLACK = Stiffness(structural=0.0, shear=0.0, flexion=0.0)
PATH = "balloon.law.magnet.strength"


def loose(strength: float = 2.0, mesh: Path | bw.PolygonMesh | None = None, **fields) -> Scene:
    """Return a cube without springs about a pole at its middle."""
    law = {"magnet": {"strength": strength}}
    still = {"stiffness": SLACK, "damping": 0.0, "inflation": Inflation(k_normal=0.0)}
    balloon = Balloon(mesh=mesh or cube(), law=law, **still)
    fields = {"frames": 6, "substeps": 40, "gravity": 0.0, "law": {"magnet": {"pole": (0.5, 0.5, 0.5)}}} | fields
    return Scene(balloon=[balloon], **fields)


def sizes(simulator: bw.Simulator) -> np.ndarray:
    """Return the size of the cube in each world, over that at the start."""
    return np.ptp(simulator.state.points.numpy()[:, :, 1], axis=1)


def test_a_law_acts_in_every_schedule(schedule, device):
    """Each particle oscillates about the pole like a cosine, each world by its own strength."""
    simulator = stepped(bw.Simulator(loose(), device, 2, {PATH: [9.0, 25.0]}, schedule, [MAGNET]), 30)
    np.testing.assert_allclose(sizes(simulator), np.abs(np.cos([1.5, 2.5])), atol=5e-3)


def test_a_batch_is_repeated_with_the_same_law_alone(tmp_path: Path):
    write_obj(tmp_path / "cube.obj", cube())
    scene = loose(mesh=tmp_path / "cube.obj")
    summary = bw.run_batch(scene, tmp_path / "a", 2, {PATH: [1.0, 9.0]}, device="cpu", laws=[MAGNET])
    manifest = json.loads(Path(summary.manifest).read_text())
    assert manifest["laws"]["magnet"].keys() == {"force", "energy"}
    bw.repeat_batch(summary.manifest, tmp_path / "b", laws=[MAGNET])
    assert (tmp_path / "a" / "table.csv").read_bytes() == (tmp_path / "b" / "table.csv").read_bytes()
    for laws, sentence in (
        ([], r"its law magnet is missing; expected it in laws$"),
        ([MAGNET, HARDENING], r"has no law hardening; expected magnet$"),
        ([bw.particle_law(magnet, MAGNET.parameters)], r"^law magnet: its source has changed since the batch of"),
    ):
        with pytest.raises(bw.InputError, match=sentence):
            bw.repeat_batch(summary.manifest, tmp_path / "c", laws=laws)


def test_a_batch_on_workers_is_the_batch_here_if_they_can_find_the_law(tmp_path: Path):
    vary = {PATH: [1.0, 9.0]}
    here = bw.run_batch(loose(), tmp_path / "a", 2, vary, device="cpu", laws=[MAGNET])
    there = bw.run_batch(loose(), tmp_path / "b", 2, vary, cluster=bw.Cluster(workers=1), laws=[MAGNET])
    assert Path(here.table[1]).read_bytes() == Path(there.table[1]).read_bytes()
    with pytest.raises(bw.InputError, match=r"^workers 1: law magnet: other processes cannot find it; expected a gl"):
        bw.run_batch(loose(), tmp_path, 2, cluster=bw.Cluster(workers=1), laws=[magnetic()])


@pytest.mark.full
def test_a_run_and_a_comparison_have_laws(tmp_path: Path):
    summary = bw.animate(loose(), tmp_path / "out.usdc", device="cpu", laws=[MAGNET])
    assert summary.frames == 6
    options = {"size": (64, 64), "samples": 1, "device": "cpu", "laws": [MAGNET]}
    comparison = bw.compare(loose(), {PATH: [1.0, 9.0]}, tmp_path / "out.png", **options)
    volumes = [run.figures["volume"] for run in comparison.runs]
    assert volumes[0] > 1.01 * volumes[1]


@pytest.mark.full
def test_a_law_of_a_page_begins_when_its_slider_moves():
    playground = Playground(loose(0.0), "cpu", [MAGNET])
    playground.step()
    assert np.ptp(playground.points[:, 1]) == 1.0
    playground.set(PATH, 100.0)
    for _ in range(3):
        playground.step()
    assert np.ptp(playground.points[:, 1]) < 0.95
    with pytest.raises(bw.InputError, match=r"^balloon\.0\.law\.magnet\.strength: must be at least 0"):
        playground.set(PATH, -1.0)


BOUND = [law for law in TESTED if law.stiffness or law.drag]
"""laws that ask for a step"""
SHARP = ("hooke", "rubber", "string", "magnet")
"""of whose bodies Gershgorin's bound is the limit itself: two equal masses on one spring, a mass on strings along a
line, masses that know nothing of each other"""
ALIKE_EVERYWHERE = ("magnet",)
"""whose slope is the same wherever the body has gone"""


@cache
def slopes(correction: str) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return derivatives of all forces by all places and velocities at the start, of each world, shape (W, 3 P, 3 P),
    and the forces, shape (W, 3 P)."""
    law = next(law for law in TESTED if model_of_all(law, "cpu")[0].scene.correction == correction)
    model, _ = model_of_all(law, "cpu")
    reader, state = ForceReader(model), initial_state(model)

    def forces(array: Any, values: NDArray[np.float32]) -> NDArray[np.float64]:
        wp.copy(array, wp.array(values, dtype=wp.vec3, device="cpu"))
        reader.refresh(state)
        return reader.net_forces(state).numpy().reshape(len(values), -1).astype(np.float64)

    def slope_by(array: Any, step: float = 0.01) -> NDArray[np.float64]:
        start = array.numpy().copy()
        columns = []
        for particle, axis in np.ndindex(start.shape[1:]):
            aside = np.zeros_like(start)
            aside[:, particle, axis] = step
            columns.append((forces(array, start + aside) - forces(array, start - aside)) / (2.0 * step))
        forces(array, start)
        return np.stack(columns, axis=-1)

    return slope_by(state.points), slope_by(state.velocities), forces(state.points, state.points.numpy().copy())


def throws_back(stiffness: NDArray, drag: NDArray, step: float) -> bool:
    """Return whether a step of symplectic Euler amplifies with alternating sign: an eigenvalue beyond -1. Growth of one
    sign is the body's own, however short the step."""
    unit = np.eye(len(drag))
    kicked = unit + step * drag
    advance = np.block([[unit + step * step * stiffness, step * kicked], [step * stiffness, kicked]])
    values = np.linalg.eigvals(advance)
    return bool(((values.real < 0.0) & (np.abs(values) > 1.001)).any())  # float32's forces are off by some 1e-5


def true_limit(law: Law) -> float:
    """Return the longest step [s] without alternating growth, to 1e-4 of it; infinite if there is no limit."""
    model, world = model_of_all(law, "cpu")
    masses = np.repeat(particle_masses(model), 3)[:, None]
    stiffness, drag = (slope[world] / masses for slope in slopes(model.scene.correction)[:2])
    drag = drag * (law.name not in AT_THE_END)
    steps = np.geomspace(1e-3, 1e2, 100)
    beyond = [throws_back(stiffness, drag, step) for step in steps]
    if not any(beyond):
        return np.inf
    first = int(np.argmax(beyond))
    low, high = steps[max(first - 1, 0)], steps[first]
    while high > 1.0001 * low:
        middle = np.sqrt(low * high)
        low, high = (low, middle) if throws_back(stiffness, drag, middle) else (middle, high)
    return high


def fastest(law: Law, step: float, count: int, points: float, velocities: float) -> float:
    """Return the highest speed of the law's body in so many steps [m/s], from small random displacements."""
    substeps = min(count, 20)
    model, world = model_of_all(law, "cpu", step, substeps)
    schedule, state = GatherSchedule(model), initial_state(model)
    shake(state, points, velocities)
    highest = velocities
    for _ in range(count // substeps):
        schedule.advance_frame(state)
        highest = np.maximum(highest, np.abs(state.velocities.numpy()[world]).max())  # NaN, if it is
    return float(highest)


@pytest.mark.full
@pytest.mark.parametrize("law", BOUND, ids=lambda law: law.name)
def test_just_under_the_step_a_law_stays_as_calm_as_with_half_of_it(law: Law):
    """The speed over 2,000 steps at 0.9 of the stable step stays near that at half of it; a swing of symplectic Euler
    near its limit is up to 1 / root(1 - 0.9^2) = 2.3 times as high."""
    step = stable_step(law)
    under, half = (fastest(law, part * step, round(1800 / part), 1e-3, 1e-4) for part in (0.9, 0.45))
    assert under < 4.0 * half


@pytest.mark.full
@pytest.mark.parametrize("law", BOUND, ids=lambda law: law.name)
def test_the_step_is_not_longer_than_what_forces_really_allow(law: Law):
    step, limit = stable_step(law), true_limit(law)
    assert step <= 1.001 * limit  # see `throws_back`
    assert law.name not in SHARP or step == pytest.approx(limit, rel=1e-3)


@pytest.mark.full
@pytest.mark.parametrize("law", BOUND, ids=lambda law: law.name)
def test_just_over_what_forces_allow_a_body_blows_up(law: Law):
    """A body at 1.05 of the limit grows by at least 1.1 a step, and so by 1e8 in 200; in water the drag ends that at 60
    times its calm speed."""
    model, world = model_of_all(law, "cpu")
    forces = slopes(model.scene.correction)[2][world]
    if np.abs(forces).max() > 1e-5 and law.name not in ALIKE_EVERYWHERE:  # above rounding: 1e-7 of some 10 N
        pytest.skip(f"{law.name} carries its body to where the limit is another")
    if (limit := true_limit(law)) == np.inf:
        pytest.skip(f"{law.name} throws nothing back from where the body starts")
    over = 1.05 * limit
    calm, wild = fastest(law, 0.1 * over, 200, 1e-4, 1e-4), fastest(law, over, 200, 1e-4, 1e-4)
    assert not wild < 30.0 * calm
