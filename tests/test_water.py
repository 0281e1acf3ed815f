"""Water: pressure against closed forms and against meshes cut by trimesh, drag, stability, and worlds that differ."""

import numpy as np
import pytest
import warp as wp
from meshes import cube, grid, prism, quad_sphere, torus
from wetness import displaced, wet_part

from balloon_warp.errors import InputError
from balloon_warp.mesh import PolygonMesh
from balloon_warp.mesh.placement import place_mesh
from balloon_warp.scene import Balloon, Inflation, Scene, Stiffness, Water
from balloon_warp.simulator import Simulator

pytestmark = pytest.mark.physics

G, RHO = 9.81, 1000.0
LIMP = {
    "stiffness": Stiffness(structural=0.0, shear=0.0, flexion=0.0),
    "inflation": Inflation(k_normal=0.0),
    "damping": 0.0,
}
"""without springs, inflation or damping"""


def limp(mesh: PolygonMesh, water: Water, **fields) -> Scene:
    """Return a mesh on which only weight and water act."""
    return Scene(balloon=[Balloon(mesh=mesh, **LIMP, **fields)], water=water, net_forces=True, frames=1)


def push_of_water(mesh: PolygonMesh, level: float, device: str, **fields) -> tuple[np.ndarray, np.ndarray]:
    """Return the force [N], and torque [N m] about the origin, of the water on a mesh at rest."""
    simulator = Simulator(limp(mesh, Water(level=level), mass=1e-3, **fields), device)
    frame = simulator.read_frame()
    points = frame.points[0].astype(np.float64)
    forces = frame.net_forces[0].astype(np.float64) + [0.0, 1e-3 * G / len(points), 0.0]
    return forces.sum(axis=0), np.cross(points, forces).sum(axis=0)


def test_half_a_cube_is_lifted_by_the_water_it_displaces(device):
    """A half-submerged cube is lifted by the displaced water, without torque about its middle."""
    force, torque = push_of_water(cube(), 0.5, device, position=(-0.5, 0.0, -0.5))
    np.testing.assert_allclose(force, [0.0, 0.5 * RHO * G, 0.0], atol=1e-3)  # float32 of 5 kN
    np.testing.assert_allclose(torque, 0.0, atol=1e-3)


def test_a_heeling_cube_is_turned_by_its_metacentric_lever(device):
    """A cube heeled by t about its middle, in the surface, has its metacentric torque: the center of the wet half is
    tan t / 6 aside and 1 / 4 - tan^2 t / 12 below the middle along the cube's own axes (the wedge's moments)."""
    heel = np.radians(20.0)
    middle = np.array([0.5, 0.5, 0.5])
    turn = np.array([[np.cos(heel), -np.sin(heel), 0.0], [np.sin(heel), np.cos(heel), 0.0], [0.0, 0.0, 1.0]])
    position = tuple((-turn @ middle).tolist())
    force, torque = push_of_water(cube(), 0.0, device, rotation=(0.0, 0.0, 20.0), position=position)
    lift = 0.5 * RHO * G
    center = turn @ [-np.tan(heel) / 6.0, np.tan(heel) ** 2 / 12.0 - 0.25, 0.0]
    np.testing.assert_allclose(force, [0.0, lift, 0.0], atol=2e-3)
    np.testing.assert_allclose(torque, np.cross(center, [0.0, lift, 0.0]), atol=2e-3)


@pytest.mark.parametrize("level", [-0.6, -0.1, 0.0, 0.37, 5.0])
@pytest.mark.parametrize("mesh", [quad_sphere(5), prism(7), torus(12, 7)], ids=["ball", "prism", "torus"])
def test_force_and_torque_are_those_of_the_displaced_water(mesh, level, device):
    """Archimedes' force rho g V acts at the center of the displaced volume; for quads that are not flat, and 7-gons."""
    turned = place_mesh(mesh, "Y", 1.0, (20.0, 40.0, 70.0), (0.1, 0.2, -0.3))
    volume, center = displaced(turned, level)
    force, torque = push_of_water(turned, level, device)
    lift = np.array([0.0, RHO * G * volume, 0.0])
    scale = RHO * G * max(abs(level), 1.0)  # of the pressure, of which float32 keeps seven digits
    np.testing.assert_allclose(force, lift, atol=1e-5 * scale)
    np.testing.assert_allclose(torque, np.cross(center, lift), atol=1e-5 * scale)


def test_above_the_water_is_dry(device):
    force, torque = push_of_water(cube(), 0.0, device)
    np.testing.assert_allclose([force, torque], 0.0, atol=1e-9)


@pytest.mark.parametrize(("level", "wet_area"), [(9.0, 6.0), (0.25, 2.0), (-1.0, 0.0)])
def test_drag_follows_the_wetted_area(level: float, wet_area: float, device):
    """Drag is 1/2 rho c A v^2 against the motion of a cube with the bottom and a quarter of each side wet."""
    scene = limp(cube(), Water(level=level, drag=0.7), mass=2.0).model_copy(update={"gravity": 0.0})
    simulator = Simulator(scene, device)
    wp.copy(simulator.state.velocities, wp.full((1, 8), value=wp.vec3(3.0, 0.0, 0.0), device=device))
    force = simulator.read_frame().net_forces[0].sum(axis=0)
    np.testing.assert_allclose(force, [-0.5 * RHO * 0.7 * wet_area * 9.0, 0.0, 0.0], rtol=1e-5)


def test_drag_acts_at_the_center_of_the_wetted_area(device):
    """Drag on a moving prism acts at the center of its wetted area as trimesh cuts it, shared among particles."""
    turned = place_mesh(prism(7), "Y", 1.0, (20.0, 40.0, 70.0), (0.1, 0.2, -0.3))
    wet = wet_part(turned, 0.1)
    scene = limp(turned, Water(level=0.1)).model_copy(update={"gravity": 0.0})
    simulator = Simulator(scene, device)
    wp.copy(simulator.state.velocities, wp.full((1, 14), value=wp.vec3(0.0, 0.0, 2.0), device=device))
    frame = simulator.read_frame()
    force = np.array([0.0, 0.0, -0.5 * RHO * wet.area * 4.0])
    np.testing.assert_allclose(frame.net_forces[0].sum(axis=0), force, rtol=1e-5)
    torque = np.cross(frame.points[0], frame.net_forces[0]).sum(axis=0)
    np.testing.assert_allclose(torque, np.cross(wet.centroid, force), atol=1e-5 * wet.area * RHO)


@pytest.mark.parametrize("substeps", [1, 16])
def test_drag_slows_as_its_solution_does_whatever_the_step(substeps: int, device):
    """The speed follows v0 / (1 + k v0 t) with k = rho c A / 2 m, also where one step is hundreds of 1 / k v0."""
    scene = limp(cube(), Water(level=99.0, drag=1.0), mass=2.0)
    scene = scene.model_copy(update={"gravity": 0.0, "substeps": substeps, "frames_per_second": 10.0})
    simulator = Simulator(scene, device)
    wp.copy(simulator.state.velocities, wp.full((1, 8), value=wp.vec3(0.0, 3.0, 0.0), device=device))
    simulator.step()
    k = 0.5 * RHO * 6.0 / 2.0
    np.testing.assert_allclose(simulator.read_frame().velocities[0][:, 1], 3.0 / (1.0 + k * 3.0 * 0.1), rtol=1e-4)


def test_a_floating_block_bobs_at_its_natural_frequency(device):
    """A stiff cube half as dense as water bobs at omega^2 = rho g A / m, A its waterline."""
    mass, lifted = 500.0, 0.02
    stiff = Stiffness(structural=2e7, shear=2e7, flexion=2e7)
    balloon = Balloon(mesh=cube(), position=(0.0, lifted - 0.5, 0.0), mass=mass, **(LIMP | {"stiffness": stiff}))
    simulator = Simulator(Scene(balloon=[balloon], water=Water(drag=0.0), frames_per_second=240.0), device)
    quarter_period = 0.5 * np.pi / np.sqrt(RHO * G / mass)
    heights = []
    while len(heights) < 240 * 1.2 * quarter_period:
        heights.append(simulator.read_frame().points[0][:, 1].mean())
        simulator.step()
    crossing = np.interp(0.0, -np.array(heights), np.arange(len(heights)) / 240.0)
    assert crossing == pytest.approx(quarter_period, rel=0.003)  # the bottom is pressed in by 0.1 mm


def test_the_step_is_stable_on_water(device):
    """The step is stable on water for a sheet without springs, at most 1 kg / 9 over 1/4 m^2, or 0.44 mm, deep. Its
    particles bob at 297 / s, for which a frame of 1/60 s in one step would be too long; with steps fifty times as short
    they rise by 2.3 mm."""
    sheet = Balloon(mesh=grid(2, 2), rotation=(90.0, 0.0, 0.0), position=(0.0, -0.0002, 0.0), mass=1.0, **LIMP)
    simulator = Simulator(Scene(balloon=[sheet], water=Water(drag=0.0)), device)
    for _ in range(60):
        simulator.step()
        heights = simulator.read_frame().points[0][:, 1]
        assert np.abs(heights).max() < 4.0e-3


@pytest.mark.parametrize("schedule", ["scatter", "gather", "lanes", "block"])
def test_water_may_differ_between_worlds(schedule, device):
    """Worlds of other water are bit-identical to each alone; `scatter` adds in any order."""
    if schedule == "lanes" and device != "cpu":
        pytest.skip("lanes is for the CPU")
    balloon = Balloon(mesh=quad_sphere(3, radius=0.2), mass=0.5)
    scene = Scene(balloon=[balloon], water=Water(density=30.0), substeps=16)
    vary = {"water.level": [-0.1, 0.0, 0.1], "water.density": [30.0, 20.0, 10.0], "water.drag": [0.0, 1.0, 2.0]}
    batch = Simulator(scene, device, 3, vary, schedule)
    for _ in range(3):
        batch.step()
    for world in range(3):
        water = Water(**{path.removeprefix("water."): values[world] for path, values in vary.items()})
        alone = Simulator(scene.model_copy(update={"water": water}), device, schedule=schedule)
        for _ in range(3):
            alone.step()
        found, expected = batch.state.points.numpy()[world], alone.state.points.numpy()[0]
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-6 if schedule == "scatter" else 0.0)


def test_water_cannot_differ_where_there_is_none():
    with pytest.raises(InputError, match=r"^water\.level: cannot differ between worlds, the scene has no water$"):
        Simulator(Scene(balloon=[Balloon(mesh=cube())]), "cpu", 2, {"water.level": [0.0, 1.0]})
