"""Worlds that differ: each is the scene with its own values, and nothing else."""

import numpy as np
import pytest
from meshes import cube, quad_sphere
from work import lines_executed

from balloon_warp.errors import InputError
from balloon_warp.model import ModelPlan, plan_model
from balloon_warp.scene import Balloon, Ground, Inflation, Scene, Sphere, Stiffness, String
from balloon_warp.scene.overrides import override_scene
from balloon_warp.simulator import Simulator

FLOAT32 = 1.2e-7
"""relative rounding of float32"""
NO_SPRINGS = Stiffness(structural=0.0, shear=0.0, flexion=0.0)


def falling_cube(**fields) -> Balloon:
    fields = {"stiffness": NO_SPRINGS, "inflation": Inflation(k_normal=0.0), "damping": 0.0} | fields
    return Balloon(mesh=cube(), **fields)


def everything() -> Scene:
    """Return a scene where every varied value matters: a sphere on the balloon, a taut string, ramped inflation."""
    ramp = Inflation(k_normal=[(0.0, 0.5), (0.05, 1.0), (0.1, 2.0)])
    balloons = [
        Balloon(mesh=quad_sphere(3), helium=3.0, inflation=ramp),
        Balloon(mesh=cube(), position=(3.0, 0.0, 0.0), inflation=Inflation(k_normal=[(0.0, 0.1), (0.05, 0.4)])),
    ]
    return Scene(
        balloon=balloons,
        sphere=[
            Sphere(position=(0.3, 1.1, 0.1), radius=0.4),
            Sphere(position=(3.5, 1.2, 0.5), radius=0.3),
            Sphere(position=(-3.0, -0.75, 0.0), velocity=(0.0, -1.0, 0.0), radius=0.3),
        ],
        string=[String(anchor=(0.0, -2.0, 0.0), length=0.5)],
        ground=Ground(height=-1.1),
        frames=4,
        frames_per_second=30,
        substeps=40,
    )


def end_state(simulator: Simulator, world: int) -> np.ndarray:
    frame = simulator.read_frame(world)
    moving = [*frame.points, *frame.velocities, frame.sphere_positions, frame.sphere_velocities]
    return np.concatenate([part.ravel() for part in moving])


def run(simulator: Simulator) -> Simulator:
    for _ in range(simulator.model.scene.frames):
        simulator.step()
    return simulator


def test_free_fall_goes_by_each_worlds_gravity(device):
    """Symplectic Euler gives x = -g h^2 n (n + 1) / 2 after n steps."""
    gravity = np.array([0.0, 1.62, 9.81, -3.0])
    scene = Scene(balloon=[falling_cube()], frames=6, frames_per_second=6, substeps=20)
    simulator = run(Simulator(scene, device, 4, {"gravity": gravity}))
    h, n = 1.0 / 120, 120
    for world, g in enumerate(gravity):
        fallen = simulator.read_frame(world).points[0][:, 1] - cube().points[:, 1]
        np.testing.assert_allclose(fallen, -g * h * h * n * (n + 1) / 2, rtol=n * FLOAT32, atol=1e-6)


def test_terminal_rise_goes_by_each_worlds_helium_and_damping(device):
    """The terminal velocity is v = m (helium - g) / c once the start has died away: after 20 time constants m / c."""
    helium, damping = np.array([12.0, 20.0, 9.81]), np.array([1.0, 2.0, 1.5])
    scene = Scene(balloon=[falling_cube(mass=0.05)], frames=60, frames_per_second=60, substeps=4)
    simulator = run(Simulator(scene, device, 3, {"balloon.helium": helium, "balloon.0.damping": damping}))
    for world in range(3):
        rising = simulator.read_frame(world).velocities[0][:, 1]
        np.testing.assert_allclose(rising, 0.05 * (helium[world] - 9.81) / damping[world], rtol=1e-5, atol=1e-6)


@pytest.mark.full
@pytest.mark.parametrize(
    ("path", "values"),
    [
        ("gravity", (3.0, 9.0)),
        ("balloon.mass", (0.08, 0.2)),
        ("balloon.1.mass", (0.08, 0.2)),
        ("balloon.helium", (1.0, 12.0)),
        ("balloon.0.damping", (0.05, 0.5)),
        ("balloon.stiffness.structural", (5.0, 25.0)),
        ("balloon.0.stiffness.shear", (0.0, 12.0)),
        ("balloon.0.stiffness.flexion", (0.0, 5.0)),
        ("balloon.inflation.k_normal", (0.0, 3.0)),
        ("balloon.0.inflation.k_normal.1.1", (0.2, 3.0)),
        ("balloon.0.inflation.k_normal.2.1", (0.2, 3.0)),
        ("balloon.1.inflation.k_normal.1.1", (0.2, 3.0)),
        ("sphere.mass", (0.2, 20.0)),
        ("sphere.0.radius", (0.25, 0.45)),
        ("sphere.0.penalty", (0.5, 20.0)),
        ("sphere.1.position.1", (1.1, 2.0)),
        ("sphere.0.velocity.0", (-1.0, 1.0)),
        ("string.0.length", (0.3, 0.9)),
        ("string.stiffness", (5.0, 40.0)),
        ("string.0.anchor.0", (-0.3, 0.7)),
        ("string.anchor.1", (-2.0, -1.7)),
        ("balloon.position.0", (0.013, 0.31)),
        ("balloon.1.position.2", (-0.2, 0.07)),
        ("ground.height", (-1.1, -0.91)),
        ("ground.friction", (0.05, 0.9)),
        ("ground.restitution", (0.1, 0.9)),
    ],
)
def test_a_world_of_a_batch_is_the_overridden_scene_alone(path: str, values: tuple[float, float]):
    """A world of a batch is bit-identical to the overridden scene on the CPU, where the order of the sums is fixed."""
    batch = run(Simulator(everything(), "cpu", 2, {path: np.array(values)}, schedule="lanes"))
    for world, value in enumerate(values):
        alone = run(Simulator(override_scene(everything(), [(path, value)]), "cpu", schedule="lanes"))
        np.testing.assert_array_equal(end_state(batch, world), end_state(alone, 0))
    assert np.abs(end_state(batch, 0) - end_state(batch, 1)).max() > 1e-4


def test_strings_of_no_said_length_reach_from_each_worlds_anchor_to_its_balloon():
    scene = everything().model_copy(
        update={"string": [String(anchor=(0.0, -2.0, 0.0)), String(anchor=(1, 0, 0), length=0.5)]}
    )
    heights, anchors = np.array([0.0, 0.4, 1.0]), np.array([0.0, 0.3, 0.0])
    plan = plan_model(scene, 3, {"balloon.0.position.1": heights, "string.0.anchor.0": anchors})
    lengths = plan.parameters["string_length"]
    for world in range(3):
        held = quad_sphere(3).points[plan.held[0]] + [0.0, heights[world], 0.0]
        assert lengths[world, 0] == pytest.approx(np.linalg.norm(held - [anchors[world], -2.0, 0.0]), rel=1e-12)
    np.testing.assert_array_equal(lengths[:, 1], 0.5)


def test_a_scene_without_a_ground_says_that_it_has_none():
    with pytest.raises(InputError, match=r"^ground\.height: cannot differ between worlds, the scene has no ground$"):
        plan_model(everything().model_copy(update={"ground": None}), 2, {"ground.height": [0.0, 1.0]})


def test_several_things_differ_at_once_and_the_last_named_wins():
    vary = {"balloon.mass": np.array([0.1, 0.2]), "balloon.0.mass": np.array([0.15, 0.3]), "gravity": [1.0, 2.0]}
    batch = run(Simulator(everything(), "cpu", 2, vary, schedule="lanes"))
    overrides = [("balloon.mass", 0.2), ("balloon.0.mass", 0.3), ("gravity", 2.0)]
    alone = run(Simulator(override_scene(everything(), overrides), "cpu", schedule="lanes"))
    np.testing.assert_array_equal(end_state(batch, 1), end_state(alone, 0))


@pytest.mark.parametrize(
    ("path", "values"),
    [
        ("balloon.stiffness.shear", [1e3, 9e4, 3e3]),
        ("balloon.mass", [1e-3, 2e-5, 5e-4]),
        ("string.stiffness", [1e4, 9e5, 3e4]),
    ],
)
def test_the_step_suits_the_stiffest_world(path: str, values: list[float]):
    """The stability limit is that of the stiffest world: so stiff and light that it exceeds a sphere's 16 substeps."""
    scene = everything().model_copy(update={"substeps": "auto"})
    alone = [plan_model(override_scene(scene, [(path, value)])).substeps for value in values]
    assert plan_model(scene, 3, {path: values}).substeps == max(alone) == alone[1] > min(alone)
    with pytest.raises(InputError, match=r"^substeps: \d+ are too few"):
        plan_model(scene.model_copy(update={"substeps": min(alone)}), 3, {path: values})


@pytest.mark.parametrize(
    ("vary", "complaint"),
    [
        (
            {"balloon.mass": [1.0, 1.0, -1.0, 1.0]},
            r"^balloon\.0\.mass: must be greater than 0 \(got -1\.0\), in world 2$",
        ),
        ({"sphere.1.radius": [1.0, 0.0, 1.0, 1.0]}, r"^sphere\.1\.radius: must be greater than 0 .* in world 1$"),
        ({"gravity": [1.0, 1.0, 1.0, np.nan]}, r"^gravity: must be a finite number \(got nan\), in world 3$"),
        ({"balloon.mass": [1.0, 2.0]}, r"^balloon\.mass: expected a value for each of 4 worlds \(got shape \(2,\)\)$"),
        ({"balloon.mass": ["a", "b", "c", "d"]}, r"^balloon\.mass: expected a number for each world \(got \['a'"),
        ({"balloon.mas": [1.0] * 4}, r"^balloon\.0\.mas: unknown field; did you mean mass\?$"),
        ({"sphere.5.mass": [1.0] * 4}, r"^sphere\.5\.mass: no sphere 5, the scene has 3, counted from 0$"),
        (
            {"frames": [1] * 4},
            r"^frames: cannot differ between worlds, .*; what can: gravity, corr.*, .*ground.*string\.length",
        ),
        (
            {"balloon.1.position.2": [0.0, 1.0, 0.0, 1.0e6]},
            r"^mesh: is 1 m across and 1e\+06 m from the origin, too far",
        ),
    ],
)
def test_a_wrong_value_is_told_in_a_sentence(vary: dict, complaint: str):
    with pytest.raises(InputError, match=complaint):
        plan_model(everything(), 4, vary)


def test_many_worlds_are_planned_without_a_loop_over_them():
    """Planning 65,536 worlds executes as many lines of Python as planning 16."""
    draw = np.random.default_rng(0).uniform(0.1, 1.0, 65_536)
    paths = ["balloon.mass", "balloon.stiffness.shear", "balloon.inflation.k_normal", "sphere.0.position.1"]
    scene = everything().model_copy(update={"substeps": "auto"})

    def plan_worlds(count: int) -> ModelPlan:
        return plan_model(scene, count, dict.fromkeys(paths, draw[:count]))

    plan = plan_worlds(len(draw))
    assert lines_executed(lambda: plan_worlds(len(draw))) <= 1.1 * lines_executed(lambda: plan_worlds(16))
    np.testing.assert_array_equal(plan.parameters["mass"], np.stack([draw, draw], axis=1))
    assert plan.parameters["helium"].shape == (1, 2)


def test_overriding_a_scene_keeps_all_else():
    scene = everything()
    changed = override_scene(scene, [("sphere.0.mass", 7.0)])
    assert changed.sphere[0].mass == 7.0
    assert changed.balloon[0].mesh is scene.balloon[0].mesh
    back = override_scene(changed, [("sphere.0.mass", scene.sphere[0].mass)])
    assert back.model_dump(exclude={"balloon"}) == scene.model_dump(exclude={"balloon"})


@pytest.mark.parametrize("world", [-1, 2])
def test_a_world_that_is_not_there_gets_a_sentence(world: int):
    simulator = Simulator(Scene(balloon=[Balloon(mesh=cube())]), "cpu", world_count=2)
    with pytest.raises(InputError, match=rf"^world: no world {world}; expected 0 to 1$"):
        simulator.read_frame(world)
