"""Added mass: air that moves along with a balloon."""

from typing import Any

import numpy as np
import pytest
from gas_balloons import advanced, gas_balloon, with_volume
from meshes import quad_sphere

from balloon_warp.errors import InputError
from balloon_warp.model import build_model
from balloon_warp.scene import Atmosphere, Balloon, Change, Inflation, Material, Scene
from balloon_warp.schedules.features import model_features
from balloon_warp.simulator import Simulator

pytestmark = pytest.mark.physics

PARTY = with_volume(quad_sphere(3), np.pi / 6.0 * 0.28**3)
"""28 cm"""
SHORT = {"frames_per_second": 200.0, "substeps": 8}


def accelerations(simulator: Simulator, frames: int = 1) -> list[float]:
    """Return the mean upward acceleration of each world from rest [m/s^2]."""
    advanced(simulator, frames)
    velocities = simulator.state.velocities.numpy()[:, :, 1].astype(np.float64)
    return (velocities.mean(axis=1) * simulator.model.scene.frames_per_second / frames).tolist()


def test_a_party_balloon_starts_at_the_textbooks_acceleration(schedule: str, device: str):
    """The acceleration is (rho V - m - n M) g over m + n M + c rho V: 7.40 m/s^2, and 17.82 without added mass. The
    tolerance is rounding of a gas's 1e5 Pa."""
    scene = Scene(balloon=[gas_balloon(PARTY, {"added_mass": 0.5}, mass=0.003)], **SHORT)
    vary = {"balloon.0.inflation.added_mass": [0.5, 0.0, 1.0], "atmosphere.density": [1.2041, 1.2041, 1.5]}
    simulator = Simulator(scene, device, 3, vary, schedule=schedule)
    volume, gas = np.pi / 6.0 * 0.28**3, np.pi / 6.0 * 0.28**3 / 0.0240548 * 0.0040026
    expected = [
        (rho * volume - 0.003 - gas) * 9.81 / (0.003 + gas + part * rho * volume)
        for part, rho in ((0.5, 1.2041), (0.0, 1.2041), (1.0, 1.5))
    ]
    assert expected[:2] == pytest.approx([7.40, 17.82], rel=1e-3)
    np.testing.assert_allclose(accelerations(simulator), expected, rtol=2e-3)


def test_it_is_half_of_what_a_gas_displaces_and_nothing_elsewhere():
    assert Inflation(kind="gas").added_mass == 0.5
    with pytest.raises(InputError, match=r'inflation.added_mass: needs kind = "gas"'):
        Balloon(mesh=PARTY, inflation={"kind": "pressure", "added_mass": 0.3})
    of_paper = build_model(Scene(balloon=[Balloon(mesh=PARTY)]), "cpu")
    of_gas = build_model(Scene(balloon=[Balloon(mesh=PARTY, inflation=Inflation(kind="gas"))]), "cpu")
    none = build_model(Scene(balloon=[gas_balloon(PARTY)]), "cpu")
    assert [model_features(model).takes_air_along for model in (of_paper, of_gas, none)] == [False, True, False]


def test_it_changes_as_it_is_told(device: str):
    """A planned change of the added mass acts from the next frame on."""
    change = Change(time=0.005, set={"balloon.0.inflation.added_mass": 2.0})
    still = {"atmosphere": Atmosphere(density=2.0), "gravity": 1.0, **SHORT}
    scene = Scene(balloon=[gas_balloon(PARTY, {"molar_mass": 0.0}, mass=0.01)], change=[change], **still)
    simulator = Simulator(scene, device)
    speeds = []
    for _ in range(2):
        speeds.append(advanced(simulator, 1).velocities[0][:, 1].astype(np.float64).mean())
    displaced = 2.0 * np.pi / 6.0 * 0.28**3
    rates = np.diff([0.0, *speeds]) * 200.0
    expected = [(displaced - 0.01) / 0.01, (displaced - 0.01) / (0.01 + 2.0 * displaced)]
    np.testing.assert_allclose(rates, expected, rtol=5e-3)


def test_it_weighs_nothing(device: str):
    """Added mass has no weight: a balloon as heavy as the air that it displaces floats."""
    displaced = 1.2 * np.pi / 6.0 * 0.28**3
    balloon = gas_balloon(PARTY, {"molar_mass": 0.0, "added_mass": 3.0}, mass=displaced)
    scene = Scene(balloon=[balloon], atmosphere=Atmosphere(density=1.2), **SHORT)
    assert abs(accelerations(Simulator(scene, device), 3)[0]) < 1e-3 * 9.81


@pytest.mark.full
@pytest.mark.parametrize("made_of", [{"mass": 0.5}, {"material": Material(preset="latex")}], ids=["springs", "rubber"])
def test_a_block_weighs_air_at_the_height_that_all_do(device: str, made_of: dict[str, Any]):
    """Air thins by 1e-4 of itself in a meter. A block may order particles differently, and weighs it as `gather`."""
    balloon = Balloon(mesh=quad_sphere(9, 2.0), inflation=Inflation(kind="gas", added_mass=0.5), **made_of)
    air = Atmosphere(pressure=101325.0, temperature=288.15, lapse=0.0065)
    weighed = []
    for schedule in ("gather", "block"):
        simulator = Simulator(Scene(balloon=[balloon], atmosphere=air, **SHORT), device, schedule=schedule)
        simulator.step()
        weighed.append(simulator.state.air_along.numpy()[0, 0])
    assert weighed[0] == pytest.approx(weighed[1], rel=2e-6)
