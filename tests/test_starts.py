"""How balloons start: turned and shifted from world to world, and already moving."""

import numpy as np
import pytest
from meshes import quad_sphere

from balloon_warp import Balloon, InputError, Scene, Simulator, String
from balloon_warp.model import build_model, plan_model
from balloon_warp.model.starts import start_of
from balloon_warp.outputs.usd.grid_layout import world_bounds
from balloon_warp.scene.overrides import override_scene

EGG = quad_sphere(3)
EGG.points[:] *= (1.0, 2.0, 3.0)
STRETCHED = Scene(
    balloon=[
        Balloon(mesh=quad_sphere(2), position=(-9.0, 0.0, 0.0)),
        Balloon(mesh=EGG, position=(4.0, 5.0, 6.0), rotation=(10.0, 20.0, 30.0), inflation={"kind": "gas"}),
    ],
    string=[String(anchor=(0.0, 0.0, 0.0), balloon=1, particle=5)],
    substeps=20,
)
ANGLES = np.array([20.0, 65.0, -170.0])


def turned(angle: float) -> Scene:
    return override_scene(STRETCHED, [("balloon.1.rotation.1", float(angle))])


def test_each_world_starts_as_a_scene_with_its_rotation_would():
    """Also what follows: the length of a string that is not said, the gas's load, and the grid's cells. The host has
    float64, the device's places are rounded to float32 at 10 m."""
    vary = {"balloon.1.rotation.1": ANGLES}
    plan, model = plan_model(STRETCHED, 3, vary), build_model(STRETCHED, "cpu", 3, vary)
    simulator = Simulator.of_model(model)
    for world, angle in enumerate(ANGLES):
        alone = plan_model(turned(angle))
        placed = start_of(plan.scene, plan.parameters, 1, plan.shapes[1].mesh.points)[world]
        np.testing.assert_allclose(placed, alone.shapes[1].mesh.points, atol=1e-12)
        for name in ("string_length", "initial_loads", "initial_centers"):
            np.testing.assert_allclose(plan.parameters[name][world], alone.parameters[name][0], rtol=1e-12)
        points = simulator.read_frame(world).points
        np.testing.assert_allclose(points[1], alone.shapes[1].mesh.points, atol=1e-6)
        np.testing.assert_array_equal(points[0], Simulator(STRETCHED, "cpu").read_frame().points[0])
    lowest, highest = world_bounds([plan])
    for angle in ANGLES:
        points = plan_model(turned(angle)).shapes[1].mesh.points
        assert (lowest <= points + 1e-9).all()
        assert (highest >= points - 1e-9).all()


def test_a_world_that_keeps_the_scene_s_rotation_keeps_its_bits():
    vary = {"balloon.1.rotation.1": ANGLES}
    many, one = Simulator(STRETCHED, "cpu", 3, vary, "gather"), Simulator(STRETCHED, "cpu", schedule="gather")
    for simulator in (many, one):
        for _ in range(3):
            simulator.step()
    np.testing.assert_array_equal(many.read_frame(0).points[1], one.read_frame().points[1])
    apart = Simulator(turned(ANGLES[1]), "cpu", schedule="gather")
    for _ in range(3):
        apart.step()
    np.testing.assert_allclose(many.read_frame(1).points[1], apart.read_frame().points[1], atol=1e-4)


def test_what_hangs_on_how_a_balloon_stands_is_refused():
    hung = override_scene(STRETCHED, [("string.0.particle", "lowest")])
    plan_model(hung, 2, {"balloon.0.rotation.1": [0.0, 50.0]})
    with pytest.raises(
        InputError, match=r"^balloon\.1\.rotation: in world 1 another particle is the lowest, which str"
    ):
        plan_model(hung, 2, {"balloon.1.rotation.0": [10.0, 90.0]})
    graded = override_scene(STRETCHED, [("balloon.1.stiffness.gradient", [1.0, 2.0])])
    with pytest.raises(InputError, match=r"^balloon\.1\.rotation: cannot differ between worlds while stiffness\.grad"):
        plan_model(graded, 2, {"balloon.1.rotation.0": [10.0, 90.0]})
    small = quad_sphere(1, 1e-3)
    small.points[:] += (0.0, 7.0, 0.0)
    near = Scene(balloon=[Balloon(mesh=small, position=(0.0, -7.0, 0.0))])
    with pytest.raises(InputError, match=r"14\.0006 m from the origin, too far for 32-bit numbers"):
        plan_model(near, 2, {"balloon.rotation.0": [0.0, 180.0]})


FREE = Scene(
    gravity=0.0,
    balloon=[
        Balloon(
            mesh=EGG,
            position=(1.0, 2.0, 3.0),
            mass=0.5,
            damping=0.0,
            helium=0.0,
            inflation={"kind": "pressure"},
            velocity=(1.0, -2.0, 0.5),
            angular_velocity=(0.3, 0.2, -0.4),
        )
    ],
)


def momenta(simulator: Simulator, world: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Linear and angular, about the origin, in float64."""
    frame, model = simulator.read_frame(world), simulator.model
    masses = 0.5 * model.particle_mass_share.numpy().astype(np.float64)[:, None]
    points, velocities = frame.points[0].astype(np.float64), frame.velocities[0].astype(np.float64)
    return (masses * velocities).sum(axis=0), (masses * np.cross(points, velocities)).sum(axis=0)


def test_a_balloon_starts_as_a_rigid_body_moves():
    frame = Simulator(FREE, "cpu").read_frame()
    arms = frame.points[0] - frame.points[0].mean(axis=0)
    expected = np.array([1.0, -2.0, 0.5]) + np.cross([0.3, 0.2, -0.4], arms)
    np.testing.assert_allclose(frame.velocities[0], expected, atol=1e-5)


def test_free_flight_keeps_both_momenta():
    """Springs pull in pairs along their lengths; float32 rounds 56 particles some hundred times."""
    simulator = Simulator(FREE, "cpu")
    start = momenta(simulator)
    np.testing.assert_allclose(start[0], 0.5 * np.array([1.0, -2.0, 0.5]), atol=1e-6)
    for _ in range(30):
        simulator.step()
    for before, after in zip(start, momenta(simulator), strict=True):
        np.testing.assert_allclose(after, before, atol=2e-4)
    center = simulator.read_frame().points[0].mean(axis=0)
    np.testing.assert_allclose(center, np.array([1.0, 2.0, 3.0]) + 0.5 * np.array([1.0, -2.0, 0.5]), atol=1e-4)


def test_velocities_differ_between_worlds_and_pins_stay():
    pinned = override_scene(FREE, [("balloon.fixed", [4]), ("balloon.angular_velocity", [0.0, 0.0, 0.0])])
    simulator = Simulator(pinned, "cpu", 2, {"balloon.velocity.0": [0.0, 3.0]})
    first, second = (simulator.read_frame(world).velocities[0] for world in (0, 1))
    np.testing.assert_array_equal(np.delete(second - first, 4, axis=0), np.tile([3.0, 0.0, 0.0], (55, 1)))
    np.testing.assert_array_equal(second[4], 0.0)


def test_a_fast_start_takes_the_step_that_its_drag_asks_for():
    """Drag in air is stiffer the faster a balloon goes; a very light one would be thrown back."""
    light = override_scene(FREE, [("balloon.mass", 1e-3), ("balloon.drag_coefficient", 2.0)])
    soft = override_scene(light, [(f"balloon.stiffness.{kind}", 1e-3) for kind in ("structural", "shear", "flexion")])
    fast = override_scene(soft, [("balloon.velocity.0", 3.0)])
    assert plan_model(fast).substeps > plan_model(soft).substeps


def test_what_starts_cannot_change_later():
    for path in ("balloon.velocity", "balloon.rotation.1", "balloon.angular_velocity.0"):
        late = override_scene(
            FREE, [("change", [{"time": 0.1, "set": {path: 1.0 if path[-1].isdigit() else [1, 0, 0]}}])]
        )
        with pytest.raises(InputError, match=f"^change\\.0\\.set: {path}: cannot change"):
            plan_model(late)
