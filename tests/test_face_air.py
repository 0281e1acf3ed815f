"""Lift and drag of faces in the air."""

import numpy as np
import pytest
import warp as wp
from gas_balloons import NO_SPRINGS
from meshes import grid, quad_sphere
from odd_meshes import finned

from balloon_warp import Parameter, face_law
from balloon_warp.mesh import PolygonMesh
from balloon_warp.scene import Atmosphere, Balloon, Inflation, Scene
from balloon_warp.simulator import Simulator

pytestmark = pytest.mark.physics

STILL = {"stiffness": NO_SPRINGS, "damping": 0.0, "inflation": Inflation(kind="pressure", pressure=0.0)}


def force_on(device: str, balloon: Balloon, air: Atmosphere) -> np.ndarray:
    """Return the net force at the start [N]."""
    simulator = Simulator(Scene(balloon=[balloon], gravity=0.0, atmosphere=air, net_forces=True), device)
    return simulator.read_frame().net_forces[0].astype(np.float64).sum(axis=0)


@pytest.mark.parametrize("angle", [10.0, 45.0, 90.0])
def test_a_plate_at_an_angle_has_lift_and_drag(angle: float, device: str):
    """A plate at the angle a to a wind along x has the force 1/2 rho A C_n u^2 sin a along its normal, and 1/2 rho A
    C_t u^2 cos a along itself."""
    plate = Balloon(mesh=grid(3, 2), rotation=(0.0, angle, 0.0), face_drag=1.2, face_friction=0.05, **STILL)
    lift_axis = np.array([0.0, 0.0, 1.0])
    force = force_on(device, plate, Atmosphere(density=1.3, wind=(5.0, 0.0, 0.0)))
    sine, cosine = np.sin(np.radians(angle)), np.cos(np.radians(angle))
    unit = 0.5 * 1.3 * 6.0 * 5.0**2
    assert force[0] == pytest.approx(unit * (1.2 * sine * sine + 0.05 * cosine * cosine), rel=1e-4)
    assert abs(force @ lift_axis) == pytest.approx(unit * (1.2 - 0.05) * sine * cosine, rel=1e-4, abs=1e-3)
    assert force[1] == pytest.approx(0.0, abs=1e-3)


def test_it_is_pushed_to_the_lee(device: str):
    """A kite leaned with the wind is lifted: both of its sides act alike."""
    for turned in (0.0, 180.0):
        kite = Balloon(mesh=grid(1, 1), rotation=(-60.0 + turned, 0.0, 0.0), face_drag=1.0, **STILL)
        force = force_on(device, kite, Atmosphere(density=1.2, wind=(0.0, 0.0, 4.0)))
        assert force[2] > 0.0
        assert force[1] > 0.5 * force[2] / np.tan(np.radians(60.0))


@pytest.mark.parametrize(("drag", "friction"), [(0.3, 0.0), (0.0, 0.2), (0.3, 0.05)])
def test_a_sphere_has_the_integral_of_its_faces(drag: float, friction: float, device: str):
    """A sphere's drag coefficient is C_d = 4/3 C_n + 8/3 C_t, on 1/2 rho pi R^2 u^2, within the mesh's 0.5%."""
    ball = Balloon(
        mesh=quad_sphere(12, 0.2), face_drag=drag, face_friction=friction, velocity=(3.0, -4.0, 1.0), **STILL
    )
    wind = np.array([0.0, 0.0, 2.0])
    relative = wind - (3.0, -4.0, 1.0)
    force = force_on(device, ball, Atmosphere(density=1.3, wind=tuple(wind)))
    coefficient = 4.0 / 3.0 * drag + 8.0 / 3.0 * friction
    expected = 0.5 * 1.3 * coefficient * np.pi * 0.2**2 * np.linalg.norm(relative) * relative
    np.testing.assert_allclose(force, expected, atol=0.015 * np.linalg.norm(expected))


@wp.func
def lift(up: wp.vec3, lift: float):
    """Return a force on a face, whatever its area [N]."""
    return lift * up


@pytest.mark.full
@pytest.mark.parametrize(("mesh", "revisits"), [(quad_sphere(8, 0.5), False), (finned(), True)], ids=["ball", "fin"])
def test_corners_bear_the_whole_force_on_a_face(mesh: PolygonMesh, revisits: bool, device: str):
    """Faces of a fin run along their corners and back again, so that they pass some particles twice."""
    law = face_law(lift, [Parameter("lift", "N", 0.5)])
    simulator = Simulator(
        Scene(balloon=[Balloon(mesh=mesh, mass=1.0, **STILL)], gravity=0.0), device, schedule="gather", laws=[law]
    )
    assert simulator.schedule.launches.step.features.revisits == revisits
    simulator.step()
    frame = simulator.read_frame()
    momentum = simulator.model.particle_mass_share.numpy() @ frame.velocities[0]
    np.testing.assert_allclose(momentum, [0.0, mesh.face_count * 0.5 * frame.time, 0.0], rtol=1e-4, atol=1e-5)
