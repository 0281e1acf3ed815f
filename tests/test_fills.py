"""Balloons that are filled as in practice: by breaths, litres or moles, to a pressure or a diameter, or by a pump."""

import numpy as np
import pytest
from gas_balloons import AIR_PRESSURE, GAS_CONSTANT, PRESSURE_ROUNDING, TEMPERATURE, advanced, gas_balloon, with_volume
from meshes import quad_sphere
from scipy.integrate import solve_ivp

from balloon_warp.errors import InputError
from balloon_warp.scene import Atmosphere, Balloon, Inflation, Material, Scene
from balloon_warp.scene.overrides import override_scene
from balloon_warp.simulator import Simulator

pytestmark = pytest.mark.physics

BALL = with_volume(quad_sphere(4), 0.02)
OF_A_LITRE = AIR_PRESSURE * 1e-3 / (GAS_CONSTANT * TEMPERATURE)
"""[mol]"""


def rigid(**gas) -> Scene:
    balloon = gas_balloon(BALL, gas, fixed=list(range(BALL.vertex_count)))
    return Scene(balloon=[balloon], substeps=7, frames=1000)


def soft(**gas) -> Scene:
    """Return a scene of a latex balloon, 10 cm wide."""
    balloon = Balloon(
        mesh=quad_sphere(4, 0.05),
        material=Material(preset="latex"),
        damping=0.1,
        inflation=Inflation(kind="gas", **gas),
    )
    return Scene(balloon=[balloon], gravity=0.0, frames=1000)


@pytest.mark.parametrize(
    ("how", "moles"),
    [({"litres": 2.0}, 2.0 * OF_A_LITRE), ({"breaths": 1.5}, 5.25 * OF_A_LITRE), ({"moles": 0.1}, 0.1)],
    ids=["litres", "breaths", "moles"],
)
def test_so_much_is_blown_in_evenly_over_the_time(how: dict, moles: float, schedule: str, device: str):
    """The amount grows linearly over the fill time, which ends within a frame."""
    simulator = Simulator(rigid(fill_time=0.065, **how), device, schedule=schedule)
    first = simulator.read_frame().gas_amounts[0]
    blown = [advanced(simulator, 1).gas_amounts[0] - first for _ in range(6)]
    expected = moles * np.minimum(np.arange(1, 7) / 60.0 / 0.065, 1.0)
    np.testing.assert_allclose(blown, expected, rtol=1e-5)


def test_litres_are_of_the_air_of_each_world(device: str):
    scene = rigid(litres=3.0, fill_time=0.01).model_copy(update={"atmosphere": Atmosphere()})
    simulator = Simulator(scene, device, 2, {"atmosphere.pressure": [1e5, 5e4], "balloon.inflation.litres": [3.0, 4.0]})
    first = simulator.state.gas_amounts.numpy()[:, 0].copy()
    advanced(simulator, 1)
    expected = np.array([1e5 * 3e-3, 5e4 * 4e-3]) / (GAS_CONSTANT * TEMPERATURE)
    np.testing.assert_allclose(simulator.state.gas_amounts.numpy()[:, 0] - first, expected, rtol=1e-5)


def test_it_is_blown_to_a_diameter_and_no_further(schedule: str, device: str):
    """Filling stops at the diameter of a ball with the balloon's volume, and makes up for a leak."""
    scene = soft(fill_to_diameter=0.2, fill_time=0.5, leak=1e-6)
    simulator = Simulator(scene, device, schedule=schedule)
    diameters = []
    for _ in range(50):
        frame = advanced(simulator, 1)
        diameters.append(np.cbrt(6.0 * frame.volumes[0] / np.pi))
    assert diameters[10] < 0.18
    np.testing.assert_allclose(diameters[45:], 0.2, rtol=2e-3)
    assert max(diameters) < 0.201


def test_it_is_blown_to_a_pressure_and_no_further(schedule: str, device: str):
    """Filling by a breath in five seconds stops at a pressure below the peak of rubber."""
    simulator = Simulator(soft(fill_to_pressure=1200.0, fill_time=5.0), device, schedule=schedule)
    pressures = [float(advanced(simulator, 1).pressures[0]) for _ in range(30)]
    assert max(pressures) < 1200.0 + 12.0
    np.testing.assert_allclose(pressures[20:], 1200.0, rtol=0.01)


def test_a_pump_follows_its_curve_and_stops(device: str):
    """A pump in a rigid balloon follows dn/dt = q(p) of three points, and does not run backwards beyond the last."""
    curve = [(0.0, 0.04), (1000.0, 0.03), (3000.0, 0.0)]
    simulator = Simulator(rigid(pump_curve=curve), device)
    amounts = [simulator.read_frame().gas_amounts[0]]
    amounts += [advanced(simulator, 1).gas_amounts[0] for _ in range(60)]

    def slope(_, n):
        p = n[0] * GAS_CONSTANT * TEMPERATURE / 0.02 - AIR_PRESSURE
        return [np.interp(p, *np.transpose(curve))]

    times = np.arange(61) / 60.0
    expected = solve_ivp(slope, (0.0, 1.0), [amounts[0]], t_eval=times, rtol=1e-9, max_step=1e-3).y[0]
    np.testing.assert_allclose(np.array(amounts) - amounts[0], expected - amounts[0], rtol=0.01)
    assert simulator.read_frame().pressures[0] < 3000.0
    over = Simulator(rigid(pump_curve=[(0.0, 1.0), (500.0, 1.0)]), device)
    pressures = [float(advanced(over, 1).pressures[0]) for _ in range(3)]
    np.testing.assert_allclose(pressures[1:], pressures[0], atol=PRESSURE_ROUNDING)
    assert 500.0 < pressures[0] < 800.0  # by a substep's 290 Pa at most


@pytest.mark.parametrize(
    ("fields", "complaint"),
    [
        ({"breaths": 1.0, "litres": 2.0}, "litres: gives the same quantity as breaths; expected only one of them"),
        ({"amount": 1.0, "moles": 2.0}, "moles: gives the same quantity as amount; expected only one of them"),
        ({"pump": 0.1, "breaths": 2.0}, "breaths: gives the same quantity as pump; expected only one of them"),
        ({"pump_curve": [(5.0, 1.0), (5.0, 0.0)]}, "pump_curve: pressures must increase .got .5.0, 5.0.."),
        ({"breaths": -1.0}, "breaths: must be"),
        ({"fill_time": 0.0}, "fill_time: must be"),
        ({"kind": "pressure", "litres": 1.0}, 'litres: needs kind = "gas" .got kind = "pressure".'),
    ],
)
def test_mistakes_are_told(fields: dict, complaint: str):
    with pytest.raises(InputError, match=complaint):
        override_scene(rigid(), [(f"balloon.inflation.{name}", value) for name, value in fields.items()])
