"""Balloons with open necks and leaks: outflow, its time, and its thrust."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from gas_balloons import (
    AIR_PRESSURE,
    GAS_CONSTANT,
    PRESSURE_ROUNDING,
    TEMPERATURE,
    advanced,
    gas_balloon,
    set_state,
    volume_of,
    with_volume,
)
from meshes import quad_sphere
from numpy.typing import NDArray
from pxr import Usd
from rubber_theory import ENERGIES, MATERIALS, sphere_pressure
from scipy.integrate import solve_ivp

from balloon_warp.errors import InputError
from balloon_warp.frame import Frame
from balloon_warp.mesh.geometry import signed_volume, total_area
from balloon_warp.outputs.usd import StageWriter
from balloon_warp.scene import Balloon, Change, Inflation, Neck, Scene
from balloon_warp.scene.overrides import override_scene
from balloon_warp.simulator import Simulator
from balloon_warp.sweep.recorder import Recorder, columns_of

pytestmark = pytest.mark.physics

OF_AIR = 0.0289652
"""[kg/mol]"""
BALL = with_volume(quad_sphere(4), 0.02)
FIXED = list(range(BALL.vertex_count))
SOFT = quad_sphere(4, 0.1)
SHORT = {"gravity": 0.0, "frames_per_second": 1000.0, "substeps": 4}
"""frames in which little changes, so that sums over them are integrals"""
DRY_AIR = AIR_PRESSURE * OF_AIR / (GAS_CONSTANT * TEMPERATURE)
"""its density [kg/m^3]"""


def area_of(diameter: float) -> float:
    return 0.25 * np.pi * diameter**2


def rigid(pressure: float, neck: Neck | None, substeps: int = 40, **gas: float) -> Scene:
    """Return a balloon of air that keeps its volume."""
    balloon = gas_balloon(BALL, {"start_pressure": pressure, "molar_mass": OF_AIR, **gas}, fixed=FIXED, neck=neck)
    return Scene(balloon=[balloon], substeps=substeps, frames=1000)


def flying(neck: Neck | None, device: str, schedule: str = "auto", molar_mass: float = OF_AIR, **fields) -> Simulator:
    """Return a balloon of rubber, held at twice its size by its gas; the air around takes no part."""
    material = MATERIALS["neo_hookean"].model_copy(update={"thickness": 2.5e-4, "density": 950.0})
    ball = fields.pop("mesh", SOFT)
    pressure = float(sphere_pressure(ENERGIES["neo_hookean"], ball, 2.5e-4, np.array(2.0)))
    amount = (AIR_PRESSURE + pressure) * 8.0 * signed_volume(ball) / (GAS_CONSTANT * TEMPERATURE)
    gas = Inflation(kind="gas", amount=amount, molar_mass=molar_mass, added_mass=0.0, leak=fields.pop("leak", 0.0))
    balloon = Balloon(mesh=ball, material=material, inflation=gas, neck=neck, damping=0.0, **fields)
    simulator = Simulator(Scene(balloon=[balloon], **SHORT), device, schedule=schedule)
    points = 2.0 * simulator.state.points.numpy()[0]
    set_state(simulator, points=points, pressures=[pressure], inflation_loads=[(pressure, 0.0)])
    return simulator


def left_in_rigid(area: float, start: float, seconds: NDArray[np.float64], gamma: float) -> NDArray[np.float64]:
    """Return amounts [mol] by the differential equation; without heat, p / n^gamma is constant."""
    volume, outside = 0.02, GAS_CONSTANT * TEMPERATURE / AIR_PRESSURE
    first = (AIR_PRESSURE + start) * volume / (GAS_CONSTANT * TEMPERATURE)

    def slope(_, n):
        p = (AIR_PRESSURE + start) * (n[0] / first) ** gamma - AIR_PRESSURE
        if p > 0.0:
            return [-area * np.sqrt(2.0 * p * n[0] / (volume * OF_AIR))]
        return [area * np.sqrt(-2.0 * p / DRY_AIR) / outside]

    return solve_ivp(slope, (0.0, seconds[-1]), [first], t_eval=seconds, rtol=1e-9, max_step=1e-3).y[0]


@pytest.mark.parametrize("gamma", [1.0, 1.4])
def test_a_rigid_balloon_empties_as_bernoulli_says(gamma: float, device: str):
    """A rigid balloon empties by Bernoulli's law, frame by frame; backward Euler lags by less than a step, and the
    tolerance of 2 % of a frame's outflow is a tenth of that."""
    simulator = Simulator(rigid(2000.0, Neck(diameter=0.02, discharge=0.7), gamma=gamma), device)
    amounts = [simulator.read_frame().gas_amounts[0]]
    amounts += [advanced(simulator, 1).gas_amounts[0] for _ in range(8)]
    expected = left_in_rigid(0.7 * area_of(0.02), 2000.0, np.arange(9) / 60.0, gamma)
    np.testing.assert_allclose(
        np.diff(amounts), np.diff(expected), rtol=0.02, atol=0.003 * (expected[0] - expected[-1])
    )
    assert expected[-1] < expected[0] - 0.01


def test_it_is_empty_when_it_should_be(schedule: str, device: str):
    """The time to empty is T = 2 V M sqrt(p) / (R T C_d A sqrt(2 rho)), 0.163 s: sqrt(p) falls linearly where the
    volume stays and the gas hardly thins. Then nothing changes."""
    simulator = Simulator(rigid(1000.0, Neck(diameter=0.02)), device, schedule=schedule)
    density = DRY_AIR * (1.0 + 500.0 / AIR_PRESSURE)
    emptying = (
        2.0 * 0.02 * OF_AIR * np.sqrt(1000.0) / (GAS_CONSTANT * TEMPERATURE * area_of(0.02) * np.sqrt(2.0 * density))
    )
    pressures = [1000.0, *(float(advanced(simulator, 1).pressures[0]) for _ in range(30))]
    times = np.arange(31) / 60.0
    early = times < 0.7 * emptying
    slope, start = np.polyfit(times[early], np.sqrt(np.array(pressures)[early]), 1)
    np.testing.assert_allclose(-start / slope, emptying, rtol=0.02)
    np.testing.assert_allclose(np.array(pressures)[times > 1.1 * emptying], 0.0, atol=PRESSURE_ROUNDING)


def test_what_is_drawn_in_is_air_by_the_same_law(device: str):
    simulator = Simulator(rigid(-2000.0, Neck(diameter=0.02)), device)
    amounts = [simulator.read_frame().gas_amounts[0]]
    amounts += [advanced(simulator, 1).gas_amounts[0] for _ in range(5)]
    expected = left_in_rigid(area_of(0.02), -2000.0, np.arange(6) / 60.0, 1.0)
    np.testing.assert_allclose(amounts - expected[0], expected - expected[0], atol=0.005 * (expected[-1] - expected[0]))
    np.testing.assert_allclose(simulator.read_frame().pressures, 0.0, atol=PRESSURE_ROUNDING)


def momentum(simulator: Simulator, frame: Frame) -> NDArray[np.float64]:
    """Return the momentum of the balloon and its gas [kg m/s]; gas is shared among particles."""
    model = simulator.model
    mass = float(model.parameters["mass"].numpy()[0, 0]) + frame.gas_amounts[0] * float(
        model.parameters["molar_mass"].numpy()[0, 0]
    )
    return (mass * model.shapes[0].mass_share[:, None] * frame.velocities[0]).sum(axis=0)


def flown(simulator: Simulator, frames: int) -> tuple[NDArray[np.float64], list[Frame], list[float]]:
    """Return the momentum in the end, and the frames on the way, with the flow then [mol/s]."""
    seen, flows = [], []
    for _ in range(frames):
        seen.append(advanced(simulator, 1))
        flows.append(float(simulator.state.vent_flows.numpy()[0, 0]))
    return momentum(simulator, seen[-1]), seen, flows


def test_the_jet_pushes_by_two_areas_times_the_pressure(schedule: str, device: str):
    """The thrust is 2 C_d A p, up from a neck at the bottom, and the outflow C_d A sqrt(2 p rho)."""
    simulator = flying(Neck(diameter=0.02, discharge=0.9), device, schedule)
    end, frames, flows = flown(simulator, 20)
    impulse = 2.0 * 0.9 * area_of(0.02) * sum(frame.pressures[0] for frame in frames) / 1000.0
    # what has left took its momentum along: less than a hundredth here, see the next test
    np.testing.assert_allclose(end, [0.0, impulse, 0.0], rtol=0.02, atol=2e-3 * impulse)
    last = frames[-1]
    density = last.gas_amounts[0] * OF_AIR / volume_of(simulator, last)
    expected = 0.9 * area_of(0.02) * np.sqrt(2.0 * last.pressures[0] * density) / OF_AIR
    np.testing.assert_allclose(flows[-1], expected, rtol=0.01)


def test_balloon_and_gas_keep_their_momentum(device: str):
    """Momentum is conserved as gas, eight times as heavy as air, leaves at sqrt(2 p / rho) from a balloon that moves.
    Its share by the balloon's own speed is a third of the jet's."""
    heavy = 8.0 * OF_AIR
    simulator = flying(Neck(diameter=0.07), device, molar_mass=heavy)
    end, frames, flows = flown(simulator, 300)
    speeds, jets = [], []
    for frame in frames:
        mass = float(simulator.model.parameters["mass"].numpy()[0, 0]) + heavy * frame.gas_amounts[0]
        density = frame.gas_amounts[0] * heavy / volume_of(simulator, frame)
        speeds.append(momentum(simulator, frame)[1] / mass)
        jets.append(np.sqrt(2.0 * max(frame.pressures[0], 0.0) / density))
    gone = heavy * np.array(flows) / 1000.0
    np.testing.assert_allclose(end[1], (gone * (np.array(jets) - speeds)).sum(), rtol=0.02)
    assert (gone * speeds).sum() > 0.1 * end[1]


def test_the_jet_turns_with_the_mesh(device: str):
    """The jet turns with the mesh: its neck is in the middle of a side, of a ball turned about z from x to y."""
    vertex = int(np.argmax(SOFT.points[:, 0]))
    end, _, _ = flown(flying(Neck(at=vertex, diameter=0.03), device, rotation=(0.0, 0.0, 90.0)), 10)
    assert end[1] < -1e-3
    np.testing.assert_allclose(end[[0, 2]], 0.0, atol=2e-3 * abs(end[1]))


def test_a_group_of_faces_is_a_neck(device: str):
    """A group of faces at +z is a neck; its particles get the thrust, which is that of the diameter all the same."""
    group = np.flatnonzero(SOFT.points[:, 2] > 0.6 * SOFT.points[:, 2].max())
    mesh = replace(SOFT, groups={"spout": group.astype(np.int32)})
    simulator = flying(Neck(at="spout", diameter=0.03), device, mesh=mesh)
    weights = simulator.model.neck_weights.numpy()
    assert set(np.flatnonzero(weights)) == set(group)
    np.testing.assert_allclose(weights.sum(), 1.0, rtol=1e-6)
    end, frames, _ = flown(simulator, 10)
    impulse = 2.0 * area_of(0.03) * sum(frame.pressures[0] for frame in frames) / 1000.0
    np.testing.assert_allclose(end, [0.0, 0.0, -impulse], rtol=0.02, atol=2e-3 * impulse)


def test_a_leak_lets_gas_out_and_pushes_nothing(schedule: str, device: str):
    simulator = flying(None, device, schedule, leak=2e-4)
    end, frames, flows = flown(simulator, 10)
    density = frames[-1].gas_amounts[0] * OF_AIR / volume_of(simulator, frames[-1])
    np.testing.assert_allclose(flows[-1], 2e-4 * np.sqrt(2.0 * frames[-1].pressures[0] * density) / OF_AIR, rtol=0.01)
    np.testing.assert_allclose(end, 0.0, atol=1e-5)


def test_a_neck_is_open_between_its_times_and_worlds_differ(schedule: str, device: str):
    """A neck is open from the second frame to the fourth in one world and never in another."""
    scene = rigid(2000.0, Neck(diameter=0.005, opens=0.02, closes=0.04)).model_copy(update={"frames_per_second": 100})
    simulator = Simulator(scene, device, 2, {"balloon.neck.diameter": [0.005, 0.0]}, schedule=schedule)
    pressures = [advanced(simulator, 1) and simulator.state.pressures.numpy()[:, 0].copy() for _ in range(6)]
    first, second = np.array(pressures).T
    np.testing.assert_allclose(second, 2000.0, atol=PRESSURE_ROUNDING)
    np.testing.assert_allclose(first[:2], 2000.0, atol=PRESSURE_ROUNDING)
    assert first[1] - first[2] > 50.0
    assert first[2] - first[3] > 50.0
    np.testing.assert_allclose(first[4:], first[3], atol=PRESSURE_ROUNDING)


def test_a_change_lets_it_go(device: str):
    """A planned change opens a neck that was shut at the start."""
    scene = rigid(2000.0, Neck(diameter=0.0)).model_copy(
        update={"change": [Change(time=2 / 60, set={"balloon.neck.diameter": 0.02})]}
    )
    pressures = [float(frame.pressures[0]) for frame in Simulator(scene.model_copy(update={"frames": 4}), device).run()]
    np.testing.assert_allclose(pressures[:3], 2000.0, atol=PRESSURE_ROUNDING)
    assert pressures[3] < 1900.0


@pytest.mark.parametrize(
    ("path", "value", "complaint"),
    [
        ("balloon.neck.at", 500, "neck.at: mesh has particles 0 to 97 .got 500"),
        ("balloon.neck.at", "spout", "neck.at: mesh has no group spout; it has none"),
        ("balloon.neck.diameter", 1.0, "balloon.0.neck.diameter: must be at most 0.3"),
        ("balloon.neck.diameter", -1.0, "neck.diameter: "),
        ("balloon.neck.discharge", 1.5, "neck.discharge: "),
        ("balloon.neck.opens", -1.0, "neck.opens: "),
        ("balloon.neck.closes", 0.5, "closes: must not come before it opens, at 1 s .got 0.5 s"),
        ("balloon.inflation.leak", 1.0, "balloon.0.inflation.leak: must be at most"),
        ("balloon.inflation.molar_mass", 0.0, "molar_mass: must be above 0 where gas leaves"),
        ("balloon.inflation.kind", "pressure", 'neck: needs inflation.kind = "gas" .got "pressure"'),
    ],
)
def test_mistakes_are_told(path: str, value: object, complaint: str):
    scene = rigid(2000.0, Neck(opens=1.0))
    with pytest.raises(InputError, match=complaint):
        Simulator(override_scene(scene, [(path, value)]), "cpu")


def test_what_leaves_and_pushes_is_told_in_table_and_stage(device: str, tmp_path: Path):
    """The table and the stage report the frame's moles, the mean stretch over the start, and 2 C_d A p."""
    simulator = flying(Neck(diameter=0.02, discharge=0.5), device)
    with StageWriter(tmp_path / "flight.usda", simulator.model) as writer:
        writer.write(simulator.read_frame())
        frame = advanced(simulator, 1)
        writer.write(frame)
    expected = {
        "moles": simulator.state.gas_amounts.numpy()[0, 0],
        "stretch": np.sqrt(total_area(replace(SOFT, points=frame.points[0].astype(float))) / total_area(SOFT)),
        "thrust": area_of(0.02) * simulator.state.pressures.numpy()[0, 0],
    }
    assert expected["stretch"] == pytest.approx(2.0, rel=0.01)
    record = Recorder(simulator, np.zeros(0, dtype=np.int64)).read()
    row = dict(zip(columns_of(simulator.model.scene), record.measures[0].tolist(), strict=True))
    stage = Usd.Stage.Open(str(tmp_path / "flight.usda"))
    prim = stage.GetPrimAtPath(f"/World/{simulator.model.shapes[0].name}")
    for name, value in expected.items():
        assert row["mean_stretch" if name == "stretch" else name] == pytest.approx(value, rel=1e-5)
        assert prim.GetAttribute(f"userProperties:{name}").Get(1) == pytest.approx(value, rel=1e-5)
    np.testing.assert_allclose(frame.thrusts, expected["thrust"], rtol=1e-6)
    np.testing.assert_allclose(frame.stretches, expected["stretch"], rtol=1e-6)
