"""Outer forces on groups of particles: the momentum that they give, and who shares them; and strings."""

from dataclasses import replace

import numpy as np
import pytest
from conserved import advanced
from meshes import quad_sphere

import balloon_warp as bw
from balloon_warp import Balloon, Change, Force, Inflation, InputError, Scene, Simulator
from balloon_warp.scene.load import override_scene

MASS = 0.1
BALL = replace(quad_sphere(3, 0.5), groups={"nose": np.array([0, 4, 9]), "tail": np.array([20, 21])})
FLOATING = Balloon(mesh=BALL, mass=MASS, damping=0.0, inflation=Inflation(k_normal=0.0))
SCENE = Scene(balloon=[FLOATING], gravity=0.0, substeps=24, force=[Force(particles=["nose", 30]), Force()])
FRAMES = 3
NOSE, ALL = "force.0.newtons", "force.1.newtons"
GIVEN = np.array([[0.0, 0.0, 0.0], [0.02, -0.01, 0.03], [-0.01, 0.02, 0.0]], dtype=np.float32)


def driven(device: str, worlds: slice = slice(None), scene: Scene = SCENE) -> Simulator:
    """Return worlds that were driven at the nose, and then as a whole, too."""
    given = GIVEN[worlds]
    simulator = Simulator(scene, device, len(given))
    for frame in range(FRAMES):
        simulator.controls[NOSE] = given
        simulator.controls[ALL] = 0.5 * frame * given
        simulator.step_unread()
    return simulator


def momenta(simulator: Simulator) -> np.ndarray:
    """Return the momentum of each world [kg m/s]."""
    velocities = np.asarray(simulator.state.velocities.numpy(), dtype=np.float64)
    return np.einsum("p, wpk -> wk", MASS * simulator.model.particle_mass_share.numpy(), velocities)


@pytest.mark.parametrize("solver", ["symplectic_euler", "forward_euler", "projective"])
def test_momentum_grows_by_force_times_time(solver: str, device: str) -> None:
    """Springs add nothing to it: to float32's rounding, and for the implicit solver to its iterations' residual."""
    simulator = driven(device, scene=SCENE.model_copy(update={"solver": solver}))
    told = GIVEN / 60.0 * sum(1.0 + 0.5 * frame for frame in range(FRAMES))
    np.testing.assert_allclose(momenta(simulator), told, atol=2e-5 * np.abs(told).max())
    points = simulator.state.points.numpy()
    assert np.abs(points[1] - points[0]).max() > 1e-3


def test_no_force_changes_nothing(device: str) -> None:
    """A control at 0 and a force of 0 are bit-identical to no force, for which kernels have none."""
    controlled = driven(device, slice(0, 1))
    without = SCENE.model_copy(update={"force": []})
    for scene in (SCENE, without):
        bare = Simulator(scene, device)
        advanced(bare, FRAMES)
        for name in ("points", "velocities"):
            told = getattr(bare.state, name).numpy()
            np.testing.assert_array_equal(getattr(controlled.state, name).numpy(), told)


def test_scenes_sweeps_changes_and_whoever_sets_say_what_a_control_says(device: str) -> None:
    force = (0.02, -0.01, 0.03)
    controlled = Simulator(SCENE, device)
    controlled.controls[NOSE] = [force]
    told = Simulator(override_scene(SCENE, [(NOSE, list(force))]), device)
    varied = Simulator(SCENE, device, vary={f"{NOSE}.{axis}": [force[axis]] for axis in range(3)})
    changed = Simulator(SCENE.model_copy(update={"change": [Change(time=0.0, set={NOSE: list(force)})]}), device)
    when_set = Simulator(SCENE, device)
    when_set.step()
    when_set.reset()
    when_set.set({NOSE: [force]})
    expected = controlled.step().points[0]
    for other in (told, varied, changed, when_set):
        np.testing.assert_array_equal(other.step().points[0], expected)


def test_a_group_shares_a_force_by_mass_but_for_what_is_fixed() -> None:
    held = FLOATING.model_copy(update={"fixed": [4]})
    softer = held.model_copy(update={"stiffness": held.stiffness.model_copy(update={"even": True})})
    simulator = Simulator(SCENE.model_copy(update={"balloon": [softer]}), "cpu")
    shares, driven = simulator.model.particle_mass_share.numpy(), simulator.model.driven
    of_nose = driven.forces == 0
    assert driven.particles[of_nose].tolist() == [0, 9, 30]
    np.testing.assert_allclose(driven.shares[of_nose], shares[[0, 9, 30]] / shares[[0, 9, 30]].sum(), rtol=1e-6)
    assert driven.shares.sum() == pytest.approx(2.0)
    before = simulator.state.points.numpy()[0, 4]
    simulator.controls[ALL] = [[0.0, 1.0, 0.0]]
    np.testing.assert_array_equal(simulator.step().points[0][4], before)


def test_what_is_driven_too_hard_says_so() -> None:
    simulator = Simulator(SCENE, "cpu")
    simulator.controls[NOSE] = [[1e9, 0.0, 0.0]]
    with pytest.raises(bw.BlowUpError, match=r"outer forces pushed it with"):
        simulator.step()


@pytest.mark.parametrize(
    ("fields", "sentence"),
    [
        ({"particles": ["beak"]}, r"force\.0\.particles: mesh has no group beak; it has nose, tail"),
        ({"particles": [99]}, r"force\.0\.particles: mesh has particles 0 to 55 \(got 99\)"),
        ({"particles": []}, r"particles: must be a list of at least one item \(got \[\]\)"),
        ({"balloon": 1}, r"force\.0\.balloon: must be below the number of balloons, 1 \(got 1\)"),
        ({"particles": ["tail"]}, r"force\.0\.particles: all its particles are fixed in mesh"),
        ({"newtons": 3.0}, r"newtons: must be "),
    ],
)
def test_a_force_that_cannot_act_is_refused(fields: dict, sentence: str) -> None:
    held = FLOATING.model_copy(update={"fixed": ["tail"]})
    with pytest.raises(InputError, match=sentence):
        Simulator(Scene(balloon=[held], force=[Force(**fields)]), "cpu")


def test_a_control_of_another_shape_is_refused() -> None:
    simulator = Simulator(SCENE, "cpu", 2)
    for given in ([1.0, 2.0], np.zeros((3, 3)), np.zeros((2, 4)), "hard"):
        with pytest.raises(InputError, match=r"force\.0\.newtons: expected a (value|number) for each world"):
            simulator.controls[NOSE] = given
    with pytest.raises(InputError, match=r"force\.2\.newtons"):
        simulator.controls["force.2.newtons"]


def test_gradients_by_a_force_are_refused() -> None:
    scene = override_scene(SCENE, [(NOSE, [0.0, 0.1, 0.0]), ("frames", 1)])
    said = r"force\.0\.newtons\.1: cannot be derived by yet, for it acts by `force_newtons`"
    with pytest.raises(InputError, match=said):
        bw.gradient(scene, of=["force.0.newtons.1"], loss=bw.losses.height(1.0), device="cpu")
