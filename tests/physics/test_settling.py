"""Adaptive iterations of the `projective` solver: stiff balloons have their proper size, and steps that have not
converged are reported. Rest: motion without drift, and no larger than rounding; and whether a balance is stable."""

from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from implicit_step import one_step
from meshes import quad_sphere
from projective_scenes import kick
from scipy import sparse
from trajectories import stepped

from balloon_warp import Balloon, Inflation, InputError, Scene, Simulator, Stiffness, run_batch
from balloon_warp.frame_reader import relax
from balloon_warp.kernels.projective import LEAST_ITERATIONS, MOST_ITERATIONS
from balloon_warp.lab.statics import rigid_motions, toppling_mode

MESH = quad_sphere(6, radius=0.3)


def ball(stiffness: float, push: float, **fields) -> Scene:
    """Return a scene of a ball of 0.1 kg with stiff springs [N/m], pushed outwards by a force [N]."""
    springs = Stiffness(structural=stiffness, shear=0.5 * stiffness, flexion=0.1 * stiffness)
    inflation = Inflation(kind="normal_force", k_normal=push)
    balloon = Balloon(mesh=MESH, mass=0.1, damping=0.5, stiffness=springs, inflation=inflation)
    return Scene(balloon=[balloon], gravity=0.0, **({"solver": "projective"} | fields))


def radii(simulator: Simulator) -> np.ndarray:
    """Return the mean distance from the center in each world [m]."""
    points = simulator.state.points.numpy().astype(np.float64)
    return np.linalg.norm(points - points.mean(axis=1, keepdims=True), axis=2).mean(axis=1)


PARTS = {"structural": 1.0, "shear": 0.5, "flexion": 0.1}
STIFF = [(20.0, 2.0), (200.0, 4.0), (2000.0, 1.0), (2000.0, 20.0), (10_000.0, 0.5)]


@pytest.fixture(scope="module")
def stiff_balls() -> Simulator:
    """Return a world for each of `STIFF`, after a second."""
    vary = {f"balloon.stiffness.{kind}": [part * k for k, _ in STIFF] for kind, part in PARTS.items()}
    vary["balloon.inflation.k_normal"] = [push for _, push in STIFF]
    return stepped(Simulator(ball(20.0, 1.0), "cpu", len(STIFF), vary), 60)


@pytest.mark.parametrize("number", range(4))
def test_a_stiff_ball_grows_as_in_explicit_steps(number: int, stiff_balls: Simulator):
    """A stiff ball grows as in explicit steps to 3%, at rest: a converged implicit step has no error then, and
    iterations end where 0.2% of the springs' work may still change. Ten plain ones made a ball of 2,000 N/m shrink."""
    expected = radii(stepped(Simulator(ball(*STIFF[number], solver="symplectic_euler"), "cpu"), 180))[0]
    rest = radii(Simulator(ball(*STIFF[number]), "cpu"))[0]
    assert expected > rest
    # float32 places a point of 0.3 m to 3e-8 m, which counts where the growth is 0.3 mm
    assert radii(stiff_balls)[number] - rest == pytest.approx(expected - rest, rel=0.03, abs=2e-6)


def test_so_many_iterations_are_made_as_it_takes(stiff_balls: Simulator):
    iterations = stiff_balls.schedule._settling.iterations.numpy()
    assert iterations.min() >= LEAST_ITERATIONS
    assert iterations.max() < MOST_ITERATIONS
    assert iterations[4] > 2 * iterations[0]
    assert stiff_balls.warnings == []


def test_a_world_does_not_go_by_what_others_need(stiff_balls: Simulator):
    for number in (0, 3):
        alone = stepped(Simulator(ball(*STIFF[number]), "cpu"), 60)
        np.testing.assert_array_equal(alone.state.points.numpy()[0], stiff_balls.state.points.numpy()[number])


def test_a_step_that_has_settled_is_newtons():
    """A converged step is Newton's of backward Euler, kicked, to 1% of the effect of springs in it."""
    step, points = one_step("auto", "cpu")
    expected = step.minimum(points)
    foreseen = step.start + step.free
    assert np.abs(points - expected).max() < 0.01 * np.abs(foreseen - expected).max()


def test_what_has_not_settled_is_told():
    """Three iterations are too few for stiff springs; a world without has none. Two hundred may be too few, too."""
    vary = {f"balloon.stiffness.{kind}": [0.0, part * 2000.0] for kind, part in PARTS.items()}
    few = stepped(Simulator(ball(2.0, 0.1, solver_iterations=3), "cpu", 2, vary), 6)
    (sentence,) = few.warnings
    assert sentence.startswith('solver "projective": the iterations did not converge in frame ')
    assert " of world 1: the last one changed" in sentence
    assert 'solver_iterations = "auto" helps' in sentence
    many = Simulator(ball(2.0e7, 0.1, substeps=1), "cpu")  # a thousand iterations would be few
    kick(many)
    stepped(many, 1)
    assert "more substeps or softer springs help" in many.warnings[0]


@pytest.mark.always
def test_a_batch_tells_of_its_worlds_that_have_not(tmp_path: Path):
    told: list[str] = []
    vary = {f"balloon.stiffness.{kind}": [part * k for k in (0.0, 2000.0, 4000.0)] for kind, part in PARTS.items()}
    run_batch(ball(2.0, 0.1, solver_iterations=3, frames=6), tmp_path, 3, vary, device="cpu", on_warning=told.append)
    (sentence,) = (each for each in told if each.startswith("solver"))
    assert " of world 1: " in sentence
    assert sentence.endswith(" (and 1 more world)")


RATE, SUBSTEPS = 60, 1000
PLACE = float(np.spacing(np.float32(0.2)))


class Trembling:
    """Particle 0.2 m from the origin that drifts from frame to frame, and trembles within it."""

    def __init__(self, drift: float, trembles: float):
        self.model = SimpleNamespace(scene=SimpleNamespace(frames_per_second=RATE), substeps=SUBSTEPS)
        self._drift, self.frames, self._points = drift, 0, np.array([[[0.2, 0.0, 0.0]]])
        velocities = SimpleNamespace(numpy=lambda: np.array([[[0.0, trembles, 0.0]]]))
        self.state = SimpleNamespace(points=SimpleNamespace(numpy=self._points.copy), velocities=velocities)

    def step_unread(self) -> None:
        self._points[0, 0, 0] += self._drift / RATE
        self.frames += 1


def test_rounding_of_short_steps_does_not_count_as_motion():
    """A jitter of one unit in the last place, 1.5e-8 m * 60,000 / s or 0.9 mm/s, is at rest."""
    one_place = PLACE * RATE * SUBSTEPS
    assert one_place > 8e-4
    rests = Trembling(drift=0.0, trembles=10.0 * one_place)
    relax(rests, 1e-4, 1.0)
    assert rests.frames < 10


@pytest.mark.parametrize(("drift", "places"), [(2e-4, 0.0), (0.0, 100.0)], ids=["drifts", "trembles"])
def test_what_drifts_or_really_trembles_is_not_at_rest(drift: float, places: float):
    moves = Trembling(drift, places * PLACE * RATE * SUBSTEPS)
    with pytest.raises(InputError, match="the fastest particle still moves at"):
        relax(moves, 1e-4, 0.5)


POINTS = np.random.default_rng(0).standard_normal((8, 3))
SOFT = 5
"""Coordinate of the least stiffness"""


@dataclass(frozen=True)
class Held:
    """Balance of held particles, each coordinate with a spring of its own."""

    stiffness_of_soft: float
    squeeze: float = 0.0
    loading: bool = True

    def stiffness(self, points: np.ndarray):
        each = np.ones(points.size)
        each[SOFT] = self.stiffness_of_soft
        return sparse.diags(each).tocsc(), np.eye(points.size)[SOFT], self.squeeze


@pytest.mark.parametrize(
    ("soft", "squeeze", "topples"), [(-0.01, 0.0, True), (0.01, 0.0, False), (-0.01, 0.02, False), (-0.01, 0.005, True)]
)
def test_a_balloon_topples_where_a_stiffness_is_negative(soft: float, squeeze: float, topples: bool):
    """The mode is that of the negative stiffness; gas that resists it makes the balance stable."""
    mode = toppling_mode(Held(soft, squeeze), POINTS)  # pyright: ignore
    assert (mode is not None) == topples
    if mode is not None:
        np.testing.assert_allclose(np.abs(mode.ravel()), np.eye(POINTS.size)[SOFT], atol=1e-6)


def test_rigid_motions_keep_distances():
    motions = rigid_motions(POINTS)
    np.testing.assert_allclose(motions.T @ motions, np.eye(6), atol=1e-12)
    apart = POINTS[:, None] - POINTS[None]
    for motion in motions.T:
        moved = motion.reshape(-1, 3)
        np.testing.assert_allclose(((moved[:, None] - moved[None]) * apart).sum(axis=2), 0.0, atol=1e-12)
