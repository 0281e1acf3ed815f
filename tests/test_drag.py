"""Drag in the air."""

import numpy as np
import pytest
from gas_balloons import NO_SPRINGS, advanced, set_state
from meshes import cube, quad_sphere

from balloon_warp.errors import InputError
from balloon_warp.model import build_model
from balloon_warp.scene import Atmosphere, Balloon, Change, Inflation, Scene
from balloon_warp.simulator import Simulator

pytestmark = pytest.mark.physics


@pytest.mark.parametrize("size", [3, 6, 12])
def test_drag_on_a_sphere_is_the_textbooks(size: int, device: str):
    """Drag is 1/2 rho C_d pi R^2 u^2 relative to the wind; the mesh's error falls with its squared edges."""
    air = Atmosphere(density=1.3, wind=(0.0, 0.0, 2.0))
    balloon = Balloon(
        mesh=quad_sphere(size, 0.2),
        stiffness=NO_SPRINGS,
        damping=0.0,
        drag_coefficient=0.47,
        inflation=Inflation(k_normal=0.0),
    )
    simulator = Simulator(Scene(balloon=[balloon], gravity=0.0, atmosphere=air, net_forces=True), device)
    relative = np.array([3.0, -4.0, 1.0])
    set_state(simulator, velocities=np.tile(relative + air.wind, (simulator.model.particle_count, 1)))
    force = simulator.read_frame().net_forces[0].astype(np.float64).sum(axis=0)
    speed = np.linalg.norm(relative)
    expected = -0.5 * 1.3 * 0.47 * np.pi * 0.2**2 * speed * relative
    np.testing.assert_allclose(force, expected, atol=np.linalg.norm(expected) / size**2)

    set_state(simulator, velocities=np.tile(air.wind, (simulator.model.particle_count, 1)))
    np.testing.assert_array_equal(simulator.read_frame().net_forces[0], 0.0)


@pytest.mark.full
def test_drag_is_part_of_the_stable_step(device):
    """The stable step includes drag: a storm carries a light cube away as fast as with steps an eighth as long."""
    light = Balloon(mesh=cube(), mass=0.05, drag_coefficient=1.0, inflation=Inflation(k_normal=0.0))
    calm = Scene(balloon=[light], gravity=0.0, atmosphere=Atmosphere(density=1.2))
    storm = calm.model_copy(update={"atmosphere": Atmosphere(density=1.2, wind=(30.0, 0.0, 0.0))})
    few, enough = build_model(calm, device).substeps, build_model(storm, device).substeps
    assert enough > 10 * few
    speeds = []
    for substeps in (enough, 8 * enough):
        simulator = Simulator(storm.model_copy(update={"substeps": substeps}), device)
        advanced(simulator, 3)
        speeds.append(simulator.state.velocities.numpy()[0, :, 0].mean())
    assert speeds[0] == pytest.approx(speeds[1], rel=0.02)  # first order in a step that is an 80th of these frames
    with pytest.raises(InputError, match=f"substeps: {few} are too few"):
        Simulator(storm.model_copy(update={"substeps": few}), device)
    gust = storm.model_copy(update={"substeps": few, "atmosphere": calm.atmosphere})
    with pytest.raises(InputError, match=f"substeps: {few} are too few"):
        Simulator(gust.model_copy(update={"change": [Change(time=0.1, set={"atmosphere.wind.0": 30.0})]}), device)
