"""Balloons that are emptied: by a pump, through a leak, and filled again."""

from typing import Any

import numpy as np
import pytest
from conserved import advanced
from meshes import quad_sphere
from numpy.typing import NDArray
from test_membranes import AIR, KELVIN, volumes

from balloon_warp import Balloon, Ground, Inflation, Material, Scene, Simulator, Tube
from balloon_warp.kernels.laws.empty import end_of_collapse
from balloon_warp.mesh.geometry import signed_volume

MESH = quad_sphere(4, 0.05)
FULL = AIR * signed_volume(MESH) / (8.314462618 * KELVIN)
"""of the air's pressure in the mesh's volume [mol]"""
FLAT = 0.02
"""what is left of the mesh's volume, see `laws.empty.EMPTY`"""
LATEX: dict[str, Any] = {"material": Material(kind="neo_hookean", shear_modulus=3e5, thickness=2e-4)}
SPRINGS: dict[str, Any] = {"mass": 0.01}


def emptied(own: dict[str, Any], schedule: str, device: str, gravity: float = 9.81, **inflation: Any) -> Simulator:
    gas = Inflation(kind="gas", start_pressure=100.0, **inflation)
    balloon = Balloon(mesh=MESH, position=(0.0, 0.06, 0.0), damping=0.02, inflation=gas, **own)
    return Simulator(Scene(balloon=[balloon], ground=Ground(), gravity=gravity), device, schedule=schedule)


def course(simulator: Simulator, frames: int) -> NDArray[np.float64]:
    """Return for each frame volume over the mesh's, amount over `FULL`, pressure [Pa], highest speed [m/s]."""
    rows = []
    for _ in range(frames):
        simulator.step()
        state = simulator.state
        gas = float(state.gas_amounts.numpy()[0, 0]) / FULL, float(state.pressures.numpy()[0, 0])
        rows.append((volumes(simulator)[0] / signed_volume(MESH), *gas, np.abs(state.velocities.numpy()).max()))
    return np.array(rows)


@pytest.mark.parametrize(("own", "rate"), [(LATEX, 0.2), (LATEX, 1.0), (SPRINGS, 0.2)])
def test_a_pump_takes_no_more_from_a_flat_balloon(own: dict[str, Any], rate: float, schedule: str, device: str):
    """A pump that never stops leaves the gas of a flat balloon, at the air's pressure: within 5 % as it comes to rest,
    and a hundredth of the mesh's volume before. The walls follow the pump: the air outside, without resistance, would
    drive them to root(2 p V / m), 100 m/s and more; they have less than a tenth of that."""
    rows = course(emptied(own, schedule, device, pump=[(0.0, 0.0), (0.05, 0.0), (0.07, -rate)]), 60)
    np.testing.assert_allclose(rows[30:, 1], FLAT, rtol=1e-4)
    assert np.isfinite(rows).all()
    np.testing.assert_allclose(rows[30:, 0], FLAT, atol=0.01)
    assert rows[-1, 0] == pytest.approx(FLAT, rel=0.05)
    assert abs(rows[-1, 2]) < 100.0
    assert rows[:, 3].max() < 10.0
    assert rows[-1, 3] < 1.0


def test_a_flat_balloon_is_filled_again(schedule: str, device: str):
    again = [(0.0, -0.2), (0.4, -0.2), (0.42, 0.0), (0.48, 0.0), (0.5, FULL / 0.25), (0.73, FULL / 0.25), (0.75, 0.0)]
    rows = course(emptied(LATEX, schedule, device, pump=again), 60)
    assert rows[24, 1] == pytest.approx(FLAT, rel=1e-4)
    assert rows[-1, 1] == pytest.approx(1.02, rel=0.01)
    assert rows[-1, 0] == pytest.approx(1.02, rel=0.02)
    assert 0.0 < rows[-1, 2] < 1000.0


def test_a_leak_ends_when_the_balloon_is_flat(schedule: str, device: str):
    rows = course(emptied(LATEX, schedule, device, leak=1e-4), 70)
    assert rows[-1, 1] == pytest.approx(FLAT, rel=1e-3)
    assert rows[-1, 0] == pytest.approx(FLAT, rel=0.05)
    assert rows[:, 3].max() < 3.0


def test_a_tube_takes_no_more_from_a_flat_balloon(schedule: str, device: str):
    """The tube's flow needs 30 Pa."""
    still = {"ground": Ground(), "tube": [Tube(balloons=(0, 1), conductance=1e-2)]}
    pumps = Inflation(kind="gas", start_pressure=100.0, pump=-0.3), Inflation(kind="gas", start_pressure=100.0)
    same = {"mesh": MESH, "damping": 0.02, **SPRINGS}
    pair = [Balloon(position=(0.3 * number, 0.06, 0.0), inflation=pump, **same) for number, pump in enumerate(pumps)]
    simulator = Simulator(Scene(balloon=pair, touch=False, **still), device, schedule=schedule)
    advanced(simulator, 40)
    amounts, pressures = simulator.state.gas_amounts.numpy()[0] / FULL, simulator.state.pressures.numpy()[0]
    assert amounts[0] == pytest.approx(FLAT, rel=1e-3)
    assert FLAT <= amounts[1] < 0.3
    assert abs(pressures[0] - pressures[1]) < 30.0
    assert np.abs(simulator.state.velocities.numpy()).max() < 10.0


@pytest.mark.parametrize("volume", [1e-3, 1e-6, 0.0, -1e-6, -1e-3])
@pytest.mark.parametrize("amount", [1e-3, 1e-6, 0.0])
def test_the_end_of_a_collapse_solves_the_step(volume: float, amount: float):
    gain = 2.4e-9
    end = float(end_of_collapse(volume, gain * AIR * amount, gain * AIR))
    assert end >= 0.0
    held = gain * AIR * amount
    largest = max(roots.real for roots in np.roots([1.0, gain * AIR - volume, -held]))
    assert end == pytest.approx(max(largest, 0.0), rel=1e-4, abs=1e-12)
