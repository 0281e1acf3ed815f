"""Balloons that are pressed flat, or harder from outside than from within: by plates, by water, or in a vacuum."""

import re
from dataclasses import replace

import numpy as np
import pytest
from conserved import after_each, motion
from gas_balloons import jittered, octahedron, volume_of
from meshes import quad_sphere

from balloon_warp.mesh import PolygonMesh
from balloon_warp.mesh.crossings import crossings_of
from balloon_warp.mesh.topology import signed_volume
from balloon_warp.model.plan import plan_model
from balloon_warp.model.spectrum import PART, pressure_bound
from balloon_warp.scene import Balloon, Inflation, Material, Obstacle, Scene, Touch, Water
from balloon_warp.simulator import Simulator

RADIUS, MASS = 0.15, 0.1
BALL = quad_sphere(3, RADIUS)
VOLUME = signed_volume(BALL)


def ball(height: float = -0.5, **fields: object) -> Balloon:
    return Balloon(mesh=BALL, **{"mass": MASS, "position": (0.0, height, 0.0), **fields})


UNDER_WATER = Scene(balloon=[ball()], water=Water())
VACUUM = Scene(balloon=[ball(0.0, inflation=Inflation(pressure=-500.0), damping=0.0)], gravity=0.0)
CRUSHED = [
    pytest.param(UNDER_WATER, 6400.0, id="at all defaults"),
    pytest.param(UNDER_WATER.model_copy(update={"substeps": 9}), 6400.0, id="in few substeps"),
    pytest.param(Scene(balloon=[ball(-20.0)], water=Water()), 2e5, id="deep"),
    pytest.param(VACUUM, 500.0, id="vacuum"),
    pytest.param(
        VACUUM.model_copy(update={"balloon": [ball(0.0, inflation=Inflation(pressure=-101325.0), damping=0.0)]}),
        101325.0, id="all of the air",
    ),
]  # fmt: skip


def moved(simulator: Simulator, frames: int) -> tuple[np.ndarray, np.ndarray]:
    """Return volumes over that at the start, and kinetic energies [J], as frames end."""
    share = simulator.model.shapes[0].mass_share

    def measured(simulator: Simulator) -> tuple[float, float]:
        squares = (motion(simulator)[1] ** 2).sum(axis=1)
        return volume_of(simulator, simulator.read_frame()) / VOLUME, 0.5 * MASS * float(share @ squares)

    volumes, energies = np.transpose(after_each(simulator, frames, measured))
    return volumes, energies


@pytest.mark.parametrize(("scene", "pressure"), CRUSHED)
def test_what_presses_back_less_is_crushed_flat_and_stays_so(scene: Scene, pressure: float, schedule: str, device: str):
    """A fiftieth of the volume is left, and never less than nothing; nor is there more energy than the pressure outside
    has given, p V."""
    simulator = Simulator(scene, device, schedule=schedule)
    volumes, energies = moved(simulator, 40)
    assert volumes.min() > 0.0
    assert np.abs(volumes[30:] - 0.02).max() < 0.02
    assert energies.max() < pressure * VOLUME
    assert energies[-1] < 0.1 * pressure * VOLUME


def test_crushed_it_sinks_by_its_weight(device: str):
    """The rest of the volume lifts nothing."""
    simulator = Simulator(UNDER_WATER, device)
    moved(simulator, 20)
    heights = after_each(simulator, 40, lambda each: motion(each)[0][:, 1].mean())
    assert np.diff(heights).max() < 1e-3
    assert heights[-1] < heights[0] - 0.01


def soft(depth: float = 0.5, **fields: object) -> Scene:
    """Return a ball of default springs, which bear a tenth of what water presses harder below than above, with gas."""
    return Scene(balloon=[ball(-depth, **{"inflation": Inflation(kind="gas"), **fields})], water=Water())


def latex(depth: float = 0.5, density: float = 940.0, **gas: object) -> Scene:
    skin = Material(preset="latex", density=density)
    inflation = Inflation(kind="gas", molar_mass=0.0289652, **gas)
    return Scene(
        balloon=[Balloon(mesh=BALL, position=(0.0, -depth, 0.0), material=skin, inflation=inflation)], water=Water()
    )


@pytest.mark.parametrize("substeps", ["auto", 64])
def test_a_ball_of_gas_dents_rises_and_floats(substeps: int | str, schedule: str, device: str):
    """The volume is that of Boyle's law all the way, and at the surface it is as before."""
    scene = latex(start_pressure=300.0).model_copy(update={"substeps": substeps})
    simulator = Simulator(scene, device, schedule=schedule)
    amount = (101325.0 + 300.0) * VOLUME
    heights = []
    for _ in range(120):
        simulator.step()
        volume = volume_of(simulator, simulator.read_frame())
        inside = 101325.0 + float(simulator.state.pressures.numpy()[0, 0])
        assert volume == pytest.approx(amount / inside, rel=2e-3)
        heights.append(float(simulator.state.points.numpy()[0, :, 1].mean()))
    assert min(np.diff(heights[:30])) > 0.0
    assert heights[-1] == pytest.approx(heights[-10], abs=0.01)
    assert heights[-1] > 0.05


HEAVY = 3e5
"""Density of latex that sinks with a ball full of air [kg/m^3]"""
RELEASED = [
    pytest.param(soft(), id="half a meter"),
    pytest.param(soft(0.2), id="shallow"),
    pytest.param(soft(0.0), id="half in water"),
    pytest.param(soft(mass=30.0), id="heavy"),
    pytest.param(soft(inflation=Inflation(kind="gas", gamma=1.4)), id="without heat"),
    pytest.param(soft(20.0), id="deep"),
    pytest.param(latex(amount=1.2), id="latex with twice its gas"),
    pytest.param(latex(density=HEAVY), id="latex that sinks until it hangs slack"),
]


@pytest.mark.parametrize("scene", RELEASED)
def test_gas_in_a_soft_skin_has_the_volume_of_its_depth_and_crosses_nothing(scene: Scene, device: str):
    """Deep down, where skin hangs slack around a third of the volume, folds may cross a little, and those of a heavy
    film as it begins to sink."""
    simulator = Simulator(scene, device)
    gamma, share = scene.balloon[0].inflation.gamma, simulator.model.shapes[0].mass_share
    heights, crossings = [], []
    amount = (101325.0 + float(simulator.state.pressures.numpy()[0, 0])) * VOLUME**gamma
    for frame in range(60):
        simulator.step()
        volume = volume_of(simulator, simulator.read_frame())
        points = simulator.state.points.numpy()[0].astype(np.float64)
        heights.append(float(share @ points[:, 1]))
        inside = 101325.0 + float(simulator.state.pressures.numpy()[0, 0])
        assert inside * volume**gamma == pytest.approx(amount, rel=2e-3)
        around = 101325.0 + 9810.0 * max(-heights[-1], 0.0)
        if frame >= 10:  # the skin's own tension is up to 0.6 kPa
            assert volume == pytest.approx((amount / around) ** (1.0 / gamma), rel=0.01)
        if frame % 10 == 9:
            crossings.append(len(crossings_of(replace(BALL, points=points)).edges))
    heavy_film = scene.balloon[0].material.density == HEAVY
    assert not sum(crossings[2 if heavy_film else 0 :]) or heights[0] < -5.0
    sinks = simulator.model.parameters["mass"].numpy().item() > 1000.0 * VOLUME
    assert (heights[10] < heights[0]) == sinks


STIFF = {name: 6.0 * value for name, value in (("structural", 20.0), ("shear", 10.0), ("flexion", 2.0))}
BEARS = [
    pytest.param(soft(), 0.82, id="default springs"),
    pytest.param(soft(stiffness=STIFF), 0.0, id="stiff springs"),
    pytest.param(latex(), 0.0, id="latex"),
    pytest.param(soft(3.0, stiffness=STIFF), 0.83, id="pressed small where it starts"),
    pytest.param(latex(3.0), 1.0, id="slack where it starts"),
    pytest.param(soft(inflation=Inflation(kind="gas", amount=0.1)), 0.97, id="little gas"),
    pytest.param(soft(inflation=Inflation(kind="gas", water_evened=0.3)), 0.3, id="as said"),
    pytest.param(UNDER_WATER, 0.0, id="a pressure"),
    pytest.param(Scene(balloon=soft().balloon), 0.0, id="dry"),
]


@pytest.mark.parametrize(("scene", "evened"), BEARS)
def test_what_a_skin_does_not_bear_of_water_is_evened(scene: Scene, evened: float):
    assert plan_model(scene).parameters["water_evened"] == pytest.approx(evened, abs=0.01)


def test_worlds_even_out_by_their_own_skins():
    plan = plan_model(soft(), 2, {"balloon.0.stiffness.structural": [20.0, 600.0]})
    assert plan.parameters["water_evened"][:, 0] == pytest.approx([0.82, 0.0], abs=0.01)
    assert "its skin bears 18 %" in " ".join(plan.warnings)


TOLD = [
    pytest.param(UNDER_WATER, [r"4\.9\d? kPa", r"\d+ Pa: it is crushed flat"], id="a pressure"),
    pytest.param(
        Scene(balloon=[ball(inflation=Inflation(kind="gas", start_pressure=300.0))], water=Water()),
        [r"4\.9\d? kPa", "300 Pa: its gas shrinks", r"its skin bears 18 % .*water_evened"], id="gas",
    ),
    pytest.param(Scene(balloon=[ball(inflation=Inflation(pressure=6000.0))], water=Water()), [], id="a higher one"),
    pytest.param(Scene(balloon=[ball(0.2)], water=Water()), [], id="above the water"),
]  # fmt: skip


@pytest.mark.parametrize(("scene", "said"), TOLD)
def test_a_run_says_before_it_begins_that_water_presses_harder(scene: Scene, said: list[str]):
    told = [warning for warning in Simulator(scene, "cpu").model.warnings if "water presses" in warning]
    assert len(told) == bool(said)
    assert all(re.search(part, told[0]) for part in said)


@pytest.mark.parametrize(
    ("scene", "itself"),
    [(UNDER_WATER, "soft"), (VACUUM, "soft"), (UNDER_WATER.model_copy(update={"touch": Touch(itself=False)}), False),
     (Scene(balloon=[ball(0.2)], water=Water()), False)],
    ids=["water", "vacuum", "said otherwise", "above"],
)  # fmt: skip
def test_what_is_pressed_inward_touches_itself(scene: Scene, itself: bool | str):
    settled = Simulator(scene, "cpu").model.scene
    assert (settled.touch and settled.touch.itself) == itself or (not itself and not settled.touch)


PRESSED_RADIUS, PLATE = 0.2, 0.2


def pressed(gap: float, substeps: int | str) -> Scene:
    """Return a soft ball of gas between two plates that close to a gap in a second, wait, and open."""
    way = PRESSED_RADIUS - 0.5 * gap
    plates = [
        Obstacle(
            size=(2.0, PLATE, 2.0),
            position=(0.0, side * (PRESSED_RADIUS + 0.5 * PLATE), 0.0),
            motion=[
                (0.0, (0.0, 0.0, 0.0)),
                *((t, (0.0, -side * way, 0.0)) for t in (1.0, 1.5)),
                (2.5, (0.0, 0.0, 0.0)),
            ],
        )
        for side in (1.0, -1.0)
    ]
    gas = Inflation(kind="gas", start_pressure=20.0)
    ball = Balloon(mesh=quad_sphere(5, PRESSED_RADIUS), mass=0.05, damping=0.05, inflation=gas)
    return Scene(balloon=[ball], obstacle=plates, gravity=0.0, substeps=substeps, faces=False)  # edges are far away


@pytest.mark.always("octets-cpu-0.01-auto")
@pytest.mark.parametrize(("gap", "substeps"), [(0.03, "auto"), (0.01, "auto"), (0.01, 24)])
def test_a_ball_that_is_pressed_flat_is_whole_afterwards(gap: float, substeps: int | str, schedule: str, device: str):
    """A ball stays between the plates, within a hundredth of its size, and after the plates have opened it is as large
    as before, since its gas is: within 1e-3, of the 20 Pa in 1e5. No part is faster than the gas could make it: by a
    pressure p in the volume V a mass m gets no more than root(2 p V / m)."""
    scene = pressed(gap, substeps)
    simulator = Simulator(scene, device, schedule=schedule)
    mesh, points, most, fastest = simulator.model.shapes[0].mesh, np.zeros(0), 0.0, 0.0
    bound = simulator.model.shapes[0].pressure_bound * 0.05 / simulator.model.step_seconds**2
    for frame in range(1, 181):
        simulator.step()
        points = simulator.state.points.numpy()[0].astype(np.float64)
        room = PRESSED_RADIUS - (PRESSED_RADIUS - 0.5 * gap) * np.interp(
            frame / 60.0, [0.0, 1.0, 1.5, 2.5], [0.0, 1.0, 1.0, 0.0]
        )
        assert np.abs(points[:, 1]).max() < room + 0.02 * PRESSED_RADIUS
        most = max(most, float(simulator.state.pressures.numpy()[0, 0]))
        fastest = max(fastest, float(np.linalg.norm(simulator.state.velocities.numpy()[0], axis=1).max()))
    assert most == pytest.approx(bound, rel=1e-5)
    assert fastest < np.sqrt(2.0 * bound * signed_volume(mesh) / 0.05)
    assert signed_volume(replace(mesh, points=points)) == pytest.approx(signed_volume(mesh), rel=1e-3)
    [told] = [warning for warning in simulator.warnings if "gas was pressed" in warning]
    assert f"and pushed with just {bound:,.3g} Pa" in told


@pytest.mark.parametrize("mesh", [octahedron(), jittered(octahedron(0.3), 0.03)], ids=str)
def test_the_bound_is_that_of_the_volume_s_second_derivatives(mesh: PolygonMesh):
    """The largest eigenvalue of the Hessian by differences, between shares of mass; to a tenth where faces are bent."""
    share = np.random.default_rng(1).uniform(0.5, 1.5, mesh.vertex_count)
    share[0], share = 0.0, share / share[1:].sum()

    def volume(shift: np.ndarray) -> float:
        return signed_volume(replace(mesh, points=mesh.points + shift.reshape(-1, 3)))

    moving = np.flatnonzero(np.repeat(share > 0.0, 3))
    unit, step = np.eye(3 * mesh.vertex_count)[moving], 1e-3
    signs = [(s, t) for s in (1, -1) for t in (1, -1)]
    rows = [[sum(s * t * volume(step * (s * a + t * b)) for s, t in signs) for b in unit] for a in unit]
    hessian = np.array(rows) / (4.0 * step**2)
    roots = np.repeat(share, 3)[moving] ** -0.5
    largest = np.linalg.eigvalsh(-roots[:, None] * hessian * roots).max()
    assert PART / pressure_bound(mesh, share) == pytest.approx(largest, rel=0.1)
