"""Measures in a batch's table, against closed forms and the host's geometry in float64."""

from dataclasses import replace

import numpy as np
import pytest
import warp as wp
from meshes import cube, open_cube, quad_sphere

from balloon_warp.mesh import PolygonMesh
from balloon_warp.mesh.geometry import signed_volume, total_area
from balloon_warp.scene import Balloon, Box, Inflation, Scene, Sphere, Stiffness
from balloon_warp.simulator import Simulator
from balloon_warp.sweep.recorder import Record, Recorder, columns_of

FLOAT32 = 1.2e-7
"""relative rounding of float32"""
STILL = {"stiffness": Stiffness(structural=0.0, shear=0.0, flexion=0.0), "inflation": Inflation(k_normal=0.0)}


def record(simulator: Simulator, chosen: tuple[int, ...] = ()) -> Record:
    return Recorder(simulator, np.array(chosen, dtype=np.int64)).read()


def measured(simulator: Simulator, world: int = 0) -> dict[str, float]:
    row = record(simulator).measures[world]
    return dict(zip(columns_of(simulator.model.scene), row.tolist(), strict=True))


def put(array: wp.array, values: np.ndarray) -> None:
    wp.copy(array, wp.array(values, dtype=wp.vec3, device=array.device))


def test_a_moving_box_is_measured_exactly(device):
    """Measures are exact for the unit cube drawn out to 1 x 2 x 1 and moving at (1, 2, 2) m/s."""
    scene = Scene(balloon=[Balloon(mesh=cube(), mass=0.5, **STILL)], sphere=[Sphere(position=(7.0, 3.5, 0.0))])
    simulator = Simulator(scene, device)
    put(simulator.state.points, (cube().points * [1, 2, 1])[None])
    put(simulator.state.velocities, np.full((1, 8, 3), [1.0, 2.0, 2.0]))
    expected = {
        "volume": 2.0,
        "area": 10.0,
        "pressure": 0.0,
        "center_height": 1.0,
        "largest_stretch": 2.0,
        "kinetic_energy": 0.5 * 0.5 * 9.0,
        "sphere_0_height": 3.5,
    }
    # a mass share of an eighth, and areas and lengths that are powers of two: no rounding but the thirds of the volume
    np.testing.assert_allclose(list(measured(simulator).values()), list(expected.values()), rtol=2 * FLOAT32)
    assert list(measured(simulator)) == list(expected)


def test_what_is_in_the_box_is_counted(device):
    """A box test counts balloon centers, each coordinate by itself; a balloon has left in one of the two worlds."""
    places = [(0.0, 0.0, 0.0), (0.9, 0.0, 0.0), (0.0, -1.7, 0.0), (0.0, 0.0, 5.0)]
    balloons = [Balloon(mesh=cube(), position=place, **STILL) for place in places]
    box = Box(lower=(-0.2, -1.0, 0.0), upper=(1.5, 1.0, 1.0))
    scene = Scene(balloon=balloons, sphere=[Sphere(position=(0.1, 0.2, 0.3))], box=box, touch=False)
    simulator = Simulator(scene, device, 2, {"balloon.1.position.0": [0.9, 1.2]})
    assert [measured(simulator, world)["in_box"] for world in (0, 1)] == [2.0, 1.0]
    assert "in_box" not in measured(Simulator(scene.model_copy(update={"box": None}), device))


def test_balloons_are_summed_and_their_centers_weighed_by_mass(device):
    scene = Scene(
        balloon=[
            Balloon(mesh=cube(), mass=1.0, **STILL),
            Balloon(mesh=cube(), mass=3.0, scale=2.0, position=(5.0, 4.0, 0.0), **STILL),
        ],
        up_axis="Z",
    )
    up = scene.model_copy(update={"up_axis": "Y"})
    for turned, height in ((up, 0.25 * 0.5 + 0.75 * 5.0), (scene, 0.25 * 0.5 + 0.75 * 1.0)):
        simulator = Simulator(turned, device)
        if turned is scene:  # the meshes are Y-up: laid out as they were, so that only the axis differs
            put(simulator.state.points, Simulator(up, device).state.points.numpy())
        found = measured(simulator)
        np.testing.assert_allclose([found["volume"], found["area"]], [9.0, 30.0], rtol=4 * FLOAT32)
        np.testing.assert_allclose(found["center_height"], height, rtol=4 * FLOAT32)


def deformed(mesh: PolygonMesh, shift: float) -> PolygonMesh:
    """Return a mesh bent and dented, far from the origin, at places that float32 holds."""
    points = mesh.points * [1.0, 1.4, 0.8] + 0.15 * np.sin(4.0 * mesh.points[:, [1, 2, 0]]) + shift
    return replace(mesh, points=points.astype(np.float32).astype(np.float64))


def test_volume_and_area_are_those_of_the_host_in_float64(device):
    """Volume and area agree with the host, closed and open, at the origin and 100 m away: about its own center a
    balloon keeps the digits of float32.

    About the origin the volume at 100 m would be off by some 100^3 times float32's rounding, a tenth."""
    for mesh in (quad_sphere(9), open_cube(), quad_sphere(2)):
        for shift in (0.0, 100.0):
            bent = deformed(mesh, shift)
            simulator = Simulator(Scene(balloon=[Balloon(mesh=bent, **STILL)]), device)
            found = measured(simulator)
            np.testing.assert_allclose(found["volume"], signed_volume(bent), rtol=20 * FLOAT32)
            np.testing.assert_allclose(found["area"], total_area(bent), rtol=20 * FLOAT32)
            center = bent.points[bent.face_vertex_indices].mean(axis=0)[1]
            np.testing.assert_allclose(found["center_height"], center, rtol=4 * FLOAT32, atol=4 * FLOAT32)


def test_largest_stretch_and_kinetic_energy_are_those_of_the_host(device):
    rng = np.random.default_rng(5)
    mesh = quad_sphere(6)
    simulator = Simulator(Scene(balloon=[Balloon(mesh=mesh, mass=0.3, fixed=[4, 9])]), device)
    points = mesh.points + rng.normal(0.0, 0.05, mesh.points.shape)
    velocities = rng.normal(0.0, 1.0, mesh.points.shape)
    put(simulator.state.points, points[None])
    put(simulator.state.velocities, velocities[None])
    springs, shares = simulator.model.shapes[0].springs, simulator.model.shapes[0].mass_share
    lengths = np.linalg.norm(points[springs.pairs[:, 1]] - points[springs.pairs[:, 0]], axis=1)
    found = measured(simulator)
    np.testing.assert_allclose(found["largest_stretch"], np.max(lengths / springs.rest_lengths), rtol=1e-6)
    energy = 0.5 * np.sum(0.3 * shares * np.sum(velocities**2, axis=1))
    np.testing.assert_allclose(found["kinetic_energy"], energy, rtol=20 * FLOAT32)


def test_measures_have_the_same_bits_every_time_and_in_any_batch(device):
    scene = Scene(balloon=[Balloon(mesh=quad_sphere(7)), Balloon(mesh=cube(), position=(3, 0, 0))])
    batch, alone = Simulator(scene, device, 40), Simulator(scene, device)
    points = deformed(quad_sphere(7), 0.3).points
    for simulator in (batch, alone):
        every = simulator.state.points.numpy().copy()
        every[:, : len(points)] = points
        put(simulator.state.points, every)
    rows = [record(batch).measures for _ in range(3)]
    np.testing.assert_array_equal(rows[0], rows[1])
    np.testing.assert_array_equal(rows[0], rows[2])
    np.testing.assert_array_equal(rows[0], np.repeat(record(alone).measures, 40, axis=0))


@pytest.mark.full
def test_a_world_that_blows_up_stays_at_its_last_good_frame_and_the_others_go_on(device):
    scene = Scene(balloon=[Balloon(mesh=cube())], sphere=[Sphere(position=(0, 4, 0))], frames=4)
    simulator, healthy = Simulator(scene, device, 3), Simulator(scene, device, 3)
    recorder, undisturbed = Recorder(simulator, np.array([1, 2])), Recorder(healthy, np.array([1, 2]))
    for each in (simulator, healthy):
        each.advance()
    before = recorder.read()
    undisturbed.read()
    velocities = simulator.state.velocities.numpy().copy()
    velocities[1, 5] = np.inf
    put(simulator.state.velocities, velocities)
    for each in (simulator, healthy):
        each.advance()
        each.advance()
    after, expected = recorder.read(), undisturbed.read()
    assert before.healthy.tolist() == [1, 1, 1]
    assert after.healthy.tolist() == [1, 0, 1]
    for name in ("measures", "points", "sphere_positions"):
        old, new, good = (getattr(one, name) for one in (before, after, expected))
        frozen, living = (1, [0, 2]) if name == "measures" else (0, [1])
        np.testing.assert_array_equal(new[frozen], old[frozen])
        # on a GPU atomic adds round in any order; a neighbour's blow-up would show as far more
        np.testing.assert_allclose(new[living], good[living], rtol=1e-5, atol=1e-5)
        assert not np.array_equal(new[living], old[living])


def test_a_world_whose_speeds_overflow_is_bad_before_its_places_are(device):
    simulator = Simulator(Scene(balloon=[Balloon(mesh=cube())]), device, 2)
    recorder = Recorder(simulator, np.array([], dtype=np.int64))
    recorder.read()
    velocities = np.zeros((2, 8, 3))
    velocities[1, 3, 0] = 1e25  # its square is beyond float32
    put(simulator.state.velocities, velocities)
    after = recorder.read()
    assert after.healthy.tolist() == [1, 0]
    assert np.isfinite(after.measures).all()


@pytest.mark.full
def test_pressure_is_the_mean_by_area(device):
    """The pressure is averaged over area: a cube of 6 m^2 under 10 Pa, one of 24 m^2 whose gas starts at 40 Pa, and 100
    k_normal over the 6 m^2 of a third; at the start, and after all keyframes."""
    balloons = [
        Balloon(mesh=cube(), inflation=Inflation(kind="pressure", pressure=[(0.0, 10.0), (0.02, 30.0)])),
        Balloon(mesh=cube(), scale=2.0, inflation=Inflation(kind="gas", start_pressure=40.0)),
        Balloon(mesh=cube(), inflation=Inflation(k_normal=[(0.0, 0.6), (0.02, 1.2)])),
    ]
    still = [balloon.model_copy(update={"fixed": list(range(8))}) for balloon in balloons]
    scene = Scene(balloon=still, frames_per_second=50, substeps=1000, touch=False)
    simulator = Simulator(scene, device)
    np.testing.assert_allclose(measured(simulator)["pressure"], (6 * 10.0 + 24 * 40.0 + 60.0) / 36, rtol=1e-3)
    simulator.step()
    np.testing.assert_allclose(measured(simulator)["pressure"], (6 * 30.0 + 24 * 40.0 + 120.0) / 36, rtol=1e-3)
