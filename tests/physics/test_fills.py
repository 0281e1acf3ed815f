"""Balloons that are filled as in practice: by breaths, litres or moles, to a pressure or a diameter, or by a pump; how
overrides and sweeps change their fill; the page's slider; the paper's inflation along normals; and emptying."""

import itertools
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conserved import advanced
from gas_balloons import AIR_PRESSURE, GAS_CONSTANT, TEMPERATURE, gas_balloon, with_volume
from meshes import cube, mesh_of, quad_sphere
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from test_membranes import volumes

from balloon_warp import InputError, PolygonMesh, Simulator
from balloon_warp.mesh.orientation import triangles_of
from balloon_warp.mesh.topology import signed_volume
from balloon_warp.model import plan_model
from balloon_warp.model.parameters import VaryError, scene_to_vary
from balloon_warp.model.setting import plan_setting
from balloon_warp.scene import Balloon, Ground, Inflation, Material, Scene, Tube, load_scene
from balloon_warp.scene.load import OverrideError, parse_override
from balloon_warp.studio.page import playground as module
from balloon_warp.studio.page.playground import Playground, inflating

BALL = with_volume(quad_sphere(4), 0.02)
OF_A_LITRE = AIR_PRESSURE * 1e-3 / (GAS_CONSTANT * TEMPERATURE)
"""[mol]"""


def rigid(**gas) -> Scene:
    balloon = gas_balloon(BALL, gas, fixed=list(range(BALL.vertex_count)))
    return Scene(balloon=[balloon], substeps=7, frames=1000)


def soft(**gas) -> Scene:
    """Return a scene of a latex balloon, 10 cm wide."""
    inflation = Inflation(kind="gas", **gas)
    balloon = Balloon(mesh=quad_sphere(4, 0.05), material=Material(preset="latex"), damping=0.1, inflation=inflation)
    return Scene(balloon=[balloon], gravity=0.0, frames=1000)


@pytest.mark.parametrize(
    ("how", "moles"),
    [({"litres": 2.0}, 2.0 * OF_A_LITRE), ({"breaths": 1.5}, 5.25 * OF_A_LITRE), ({"moles": 0.1}, 0.1)],
    ids=["litres", "breaths", "moles"],
)
def test_so_much_is_blown_in_evenly_over_the_time(how: dict, moles: float, device: str):
    simulator = Simulator(rigid(fill_time=0.065, **how), device)
    first = simulator.read_frame().gas_amounts[0]
    blown = [advanced(simulator, 1).gas_amounts[0] - first for _ in range(6)]
    expected = moles * np.minimum(np.arange(1, 7) / 60.0 / 0.065, 1.0)
    np.testing.assert_allclose(blown, expected, rtol=1e-5)


def test_it_is_blown_to_a_diameter_or_a_pressure_and_no_further(device: str):
    """The diameter is of a ball with the volume; a leak is made up for; the pressure is below rubber's peak."""
    simulator = Simulator(soft(fill_to_diameter=0.2, fill_time=0.5, leak=1e-6), device)
    diameters = [np.cbrt(6.0 * advanced(simulator, 1).volumes[0] / np.pi) for _ in range(50)]
    assert diameters[10] < 0.18
    np.testing.assert_allclose(diameters[45:], 0.2, rtol=2e-3)
    assert max(diameters) < 0.201
    simulator = Simulator(soft(fill_to_pressure=1200.0, fill_time=5.0), device)
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


@pytest.mark.parametrize(
    ("field", "row"),
    [
        *(("litres", "fill_litres"), ("breaths", "fill_breaths"), ("moles", "fill_moles")),
        *(("fill_to_pressure", "fill_to_pressure"), ("leak", "leak"), ("amount", "initial_gas_amounts")),
    ],
)
def test_a_mesh_by_itself_is_filled_by_what_differs(field: str, row: str):
    vary = {f"balloon.inflation.{field}": [1e-3, 2e-3]}
    scene = scene_to_vary(quad_sphere(3), vary, {"frames": 2})
    assert scene.balloon[0].inflation.kind == "gas"
    np.testing.assert_allclose(plan_model(scene, 2, vary).parameters[row][:, 0], [1e-3, 2e-3], rtol=1e-12)


@pytest.mark.parametrize(
    ("overrides", "litres", "said"),
    [
        ({"balloon.inflation.kind": "pressure"}, [1.0, 3.0], r'inflation\.litres: needs kind = "gas"'),
        ({"balloon.inflation.pump": 0.1}, [1.0, 3.0], r"inflation\.litres: gives the same quantity as pump"),
        ({}, [-1.0, -3.0], r"inflation\.litres: must be greater than or equal to 0"),
    ],
)
def test_what_cannot_be_is_said_of_what_differs(overrides: dict, litres: list, said: str):
    vary = {"balloon.inflation.litres": litres}
    with pytest.raises(VaryError, match=said) as caught:
        plan_model(scene_to_vary(quad_sphere(3), vary, overrides), 2, vary)
    assert caught.value.path == "balloon.inflation.litres"


GAS = [("balloon.inflation.kind", "gas"), ("balloon.inflation.amount", 2.0), ("gravity", 3.0)]


def scene_file(folder: Path, *inflations: str) -> Path:
    path = folder / "scene.toml"
    path.write_text("".join(f"[[balloon]]\nmesh = 'a.obj'\n[balloon.inflation]\n{each}\n" for each in inflations))
    return path


@pytest.mark.parametrize("kind", ["", "kind = 'normal_force'\n"])
@pytest.mark.parametrize("overrides", [*itertools.permutations(GAS)])
def test_another_kind_takes_the_place_of_the_old_one_in_any_order(kind: str, overrides: list, tmp_path: Path):
    scene = load_scene(scene_file(tmp_path, f"{kind}k_normal = [[0, 1], [1, 2]]"), overrides)
    assert scene.balloon[0].inflation == Inflation(kind="gas", amount=2.0)
    assert scene.gravity == 3.0


def test_a_kind_is_replaced_where_it_is_named(tmp_path: Path):
    overrides = [("balloon.1.inflation.pressure", 9.0), ("balloon.1.inflation.kind", "pressure")]
    scene = load_scene(scene_file(tmp_path, "k_normal = 3", "k_normal = 3"), overrides)
    expected = [Inflation(k_normal=3.0), Inflation(kind="pressure", pressure=9.0)]
    assert [balloon.inflation for balloon in scene.balloon] == expected


@pytest.mark.parametrize(
    ("inflation", "overrides", "number", "said"),
    [
        ("k_normal = 3", "gravity=1 k_normal=2 kind=gas frames=9", 2, r'k_normal: needs kind = "normal_force"'),
        ("k_normal = 3", "kind=helium", 0, "kind: must be 'pressure', 'gas' or 'normal_force'"),
        ("kind = 'gas'\namount = 3", "pressure=9", 0, 'pressure: needs kind = "pressure"'),
    ],
)
def test_what_is_set_beside_another_kind_is_refused_and_named(
    inflation: str, overrides: str, number: int, said: str, tmp_path: Path
):
    words = [
        each if each.startswith(("gravity", "frames")) else f"balloon.inflation.{each}" for each in overrides.split()
    ]
    with pytest.raises(OverrideError, match=rf"inflation\.{said}") as caught:
        load_scene(scene_file(tmp_path, inflation), [parse_override(each) for each in words])
    assert caught.value.number == number


def filled(*inflations: dict) -> Scene:
    return Scene(balloon=[Balloon(mesh=quad_sphere(4, 0.5), inflation=Inflation(**fields)) for fields in inflations])


def test_what_is_blown_in_gives_way_to_the_slider():
    scene = filled({"pump": 0.5}, {"litres": 2.0}, {"breaths": 3.0}, {"moles": 1.0}, {"k_normal": 0.2})
    found = [tuple(path.split(".")[1::2]) + (value,) for path, value in inflating(scene, 0.25)]
    expected = [("0", "pump", 0.25)]
    for number, name in ("1", "litres"), ("2", "breaths"), ("3", "moles"):
        expected += [(number, name, 0.0), (number, "pump", 0.25)]
    assert found == expected


def test_a_pump_s_curve_stays():
    with pytest.raises(InputError, match=r"balloon\.1\.inflation\.pump_curve: gives the same quantity as pump"):
        inflating(filled({"pump": 0.5}, {"pump_curve": [(0.0, 1.0), (100.0, 0.0)]}), 0.25)


def test_many_balloons_are_inflated_at_once(monkeypatch: pytest.MonkeyPatch):
    """A hundred balloons are inflated by one plan: one by one the page stood still."""
    playground = Playground(load_scene("helium_rise"), "cpu")
    playground.set("gravity", 9.0)  # the scene's own plan is over now
    plans = []
    monkeypatch.setattr(module, "plan_setting", lambda *args, **kw: plans.append(1) or plan_setting(*args, **kw))
    playground.inflate(0.5 * playground.inflation)
    assert len(plans) == 1
    assert len({balloon.inflation.keyframes[0][1] for balloon in playground.live.balloon}) == 1


def forces_at_start(mesh: PolygonMesh, inflation: Inflation, device: str) -> np.ndarray:
    scene = Scene(balloon=[gas_balloon(mesh, inflation=inflation)], gravity=0.0, substeps=4)
    return Simulator(scene, device).read_frame(net_forces=True).inflation_forces[0]


def test_a_cube_corner_is_pushed_along_its_diagonal(device):
    mesh = cube()
    outward = np.sign(mesh.points - mesh.points.mean(axis=0)) / np.sqrt(3.0)
    forces = forces_at_start(mesh, Inflation(k_normal=0.3), device)
    np.testing.assert_allclose(forces, 100.0 * 0.3 / 6.0 * outward, rtol=1e-5)


def push(mesh: PolygonMesh, inflation: Inflation, device: str) -> float:
    """Return the sum of forces along the radius of a round ball [N]."""
    return float((forces_at_start(mesh, inflation, device) * mesh.points).sum())


@pytest.mark.parametrize("cells", [4, 12])
def test_k_normal_means_half_as_much_on_triangles_and_a_pressure_the_same(cells, device):
    """Quads are as many as particles, which push by nearly 100 k_normal, and twice as many triangles of half the
    area."""
    quads = quad_sphere(cells)
    meshes = quads, mesh_of(quads.points, triangles_of(quads))
    pushes = [push(mesh, Inflation(k_normal=1.0), device) for mesh in meshes]
    assert 90.0 < pushes[0] < 100.0
    assert 44.0 < pushes[1] < 52.0
    by_pressure = [push(mesh, Inflation(pressure=10.0), device) for mesh in meshes]
    assert by_pressure[1] == pytest.approx(by_pressure[0], rel=0.02)  # the same ball, but for its facets


MESH = quad_sphere(4, 0.05)
FULL = AIR_PRESSURE * signed_volume(MESH) / (GAS_CONSTANT * TEMPERATURE)
"""of the air's pressure in the mesh's volume [mol]"""
FLAT = 0.02
"""part of the mesh's volume that stays, see `laws.gas.EMPTY`"""
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
        frame = simulator.step()
        gas = frame.gas_amounts[0] / FULL, frame.pressures[0]
        rows.append((volumes(simulator)[0] / signed_volume(MESH), *gas, np.abs(frame.velocities[0]).max()))
    return np.array(rows)


@pytest.mark.parametrize(("own", "rate"), [(LATEX, 0.2), (LATEX, 1.0), (SPRINGS, 0.2)])
def test_a_pump_takes_no_more_from_a_flat_balloon(own: dict[str, Any], rate: float, schedule: str, device: str):
    """Agreement is within 5 % as it comes to rest, and a hundredth of the mesh's volume before. The air outside,
    without resistance, would drive the walls to root(2 p V / m), 100 m/s and more; they have less than a tenth of
    that."""
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
