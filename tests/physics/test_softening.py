"""Rubber's hysteresis: a deflating balloon takes less pressure than an inflating one of its size."""

from math import erf
from typing import Any

import numpy as np
import pytest
from conserved import advanced, assert_goes_on_alike, put
from meshes import grid, mesh_of, quad_sphere
from numpy.typing import NDArray
from rubber_theory import ENERGIES, MATERIALS, sphere_pressure
from test_membranes import BALL, DENSITY, THICKNESS, stretched

from balloon_warp import Balloon, Inflation, InputError, Material, PolygonMesh, Scene, Simulator
from balloon_warp.mesh.topology import signed_volume
from balloon_warp.model import plan_model
from balloon_warp.schedules.readout import ForceReader

SPHERE = quad_sphere(3, 0.1)
QUADS = SPHERE.face_vertex_indices.reshape(-1, 4).tolist()
MIXED = mesh_of(SPHERE.points, [*(part for q in QUADS[:5] for part in (q[:3], [q[0], *q[2:]])), *QUADS[5:]])
"""a ball of quads and triangles"""
SOFT = {"softening": 0.5, "softening_energy": 2.0e5, "softening_share": 0.2}
GAS, STILL = Inflation(kind="gas", start_pressure=0.0), Inflation(kind="pressure", pressure=0.0)


def left(energy: Any, peak: Any) -> NDArray[np.float64]:
    """Return the remaining fraction of the stress, by Ogden and Roxburgh's formula, apart from the simulation."""
    over = (np.asarray(peak) - energy) / (SOFT["softening_energy"] + SOFT["softening_share"] * np.asarray(peak))
    return 1.0 - SOFT["softening"] * np.vectorize(erf)(over)


def scene_of(
    kind: str, mesh: PolygonMesh = BALL, damping: float = 6.0, inflation: Inflation = GAS, **soft: float
) -> Scene:
    material = MATERIALS[kind].model_copy(update={"thickness": THICKNESS, "density": DENSITY, **SOFT, **soft})
    return Scene(balloon=[Balloon(mesh=mesh, material=material, inflation=inflation, damping=damping)], gravity=0.0)


def wear(simulator: Simulator) -> None:
    """Update the peaks, as a substep does before it computes forces."""
    state = simulator.state
    launches = simulator.schedule.launches  # type: ignore[attr-defined]
    launches.execute(state, 0, (state.points, state.velocities), ["wear"])


def test_inflated_and_deflated_the_pressure_is_the_analytic_one(device: str):
    """Softened on the way down from a stretch of 5; by virtual work of evenly stretched worlds: -F . x / 3 V."""
    stretches, most = np.linspace(1.05, 4.9, 40), 5.0
    balloons = [scene_of(kind, inflation=STILL).balloon[0] for kind in ENERGIES]
    scene = Scene(balloon=balloons, gravity=0.0, touch=False)
    simulator = Simulator(scene, device, len(stretches), schedule="gather")
    start, reader = simulator.state.points.numpy().copy(), ForceReader(simulator.model)

    def pressures(stretches: NDArray) -> NDArray[np.float64]:
        """Return the pressures by stretch and law."""
        put(simulator, start * stretches.reshape(-1, 1, 1))
        wear(simulator)
        reader.refresh(simulator.state)
        points, forces = (
            each.numpy().astype(np.float64).reshape(len(stretches), len(balloons), -1)
            for each in (simulator.state.points, reader.net_forces(simulator.state))
        )
        return -(forces * points).sum(axis=2) / (3.0 * signed_volume(BALL) * stretches[:, None] ** 3)

    rising, _, falling = (pressures(each) for each in (stretches, np.full(len(stretches), most), stretches))
    for law, energy in enumerate(ENERGIES.values()):
        up = sphere_pressure(energy, BALL, THICKNESS, stretches)
        down = up * left(energy(stretches, stretches), energy(np.array(most), np.array(most)))
        np.testing.assert_allclose(rising[:, law], up, rtol=0.005)
        np.testing.assert_allclose(falling[:, law], down, rtol=0.005)
        assert (down[:30] < 0.9 * up[:30]).all()


@pytest.mark.always
def test_a_closed_way_costs_energy_and_the_same_way_again_costs_none(device: str):
    """The formula is Ogden and Roxburgh's; where it is soft already, none."""
    sheet = grid(3, 3)
    simulator = Simulator(scene_of("neo_hookean", sheet, 0.0, inflation=STILL), device, schedule="gather")
    energy, steps = ENERGIES["neo_hookean"], np.linspace(1.0, 2.5, 151)
    points, reader = simulator.state.points.numpy()[0].copy(), ForceReader(simulator.model)

    def pull(stretch: float) -> float:
        """Return the work -F . dx / d stretch [J], with peaks updated as in a substep."""
        put(simulator, points * stretch)
        wear(simulator)
        reader.refresh(simulator.state)
        return -float((reader.net_forces(simulator.state).numpy()[0].astype(np.float64) * points).sum())

    def work(way: NDArray) -> float:
        return float(np.trapezoid([pull(stretch) for stretch in way], way))

    volume = float(simulator.model.shapes[0].membrane.areas.sum()) * THICKNESS
    up, down, again = work(steps), work(steps[::-1]), work(steps)
    stored = energy(steps, steps)
    lost = volume * np.trapezoid(1.0 - left(stored, stored[-1]), stored)
    assert up == pytest.approx(volume * stored[-1], rel=1e-3)
    assert up + down == pytest.approx(lost, rel=2e-3)
    assert again == pytest.approx(-down, rel=1e-4)
    assert lost > 0.2 * up


def test_the_step_is_stable_where_it_begins_to_give_way(device: str):
    """A balloon swings through its greatest stretches, in the automatic step, which is shorter than without."""
    sharp = {"softening": 0.9, "softening_energy": 3.0e4, "softening_share": 0.0, "most_stretch": 2.5}
    balls = "neo_hookean", quad_sphere(4, 0.1), 0.0, STILL
    scenes = [scene_of(*balls, **each) for each in (sharp, {"softening": 0.0})]
    substeps = [plan_model(scene).substeps for scene in scenes]
    assert substeps[0] > 1.5 * substeps[1]
    simulator = Simulator(scenes[0], device)
    random = np.random.default_rng(0)
    points = simulator.state.points.numpy()[0]
    put(simulator, 2.0 * points + random.normal(scale=0.003, size=points.shape))
    advanced(simulator, 10)
    reach = np.linalg.norm(simulator.state.points.numpy()[0], axis=1).max()
    assert reach < 0.21
    assert np.abs(simulator.state.velocities.numpy()).max() < 60.0


def test_it_goes_on_bit_for_bit(schedule: str, device: str):
    one, other = (Simulator(scene_of("gent", MIXED), device, schedule=schedule) for _ in range(2))
    stretched(one, 1.6)
    one.step()
    assert one.state.arrays["peak"].numpy().max() > 1e4
    assert_goes_on_alike(one, other, 2)


def test_what_does_not_soften_costs_nothing():
    plain = Scene(balloon=[Balloon(mesh=BALL, material=Material(preset="latex"), inflation=GAS)])
    assert Simulator(plain, "cpu").state.kept == {}


@pytest.mark.parametrize(
    ("fields", "sentence"),
    [
        ({"softening": 1.2}, r"material.softening: must be less than or equal to 0.95 \(got 1.2\)"),
        ({"softening": -0.1}, r"material.softening: must be greater than or equal to 0 \(got -0.1\)"),
        ({"softening_energy": 3e4}, "material.softening_energy: needs `softening`"),
        ({"softening": 0.3, "softening_energy": 0.0}, "material.softening_energy: must be greater than"),
        ({"kind": "springs", "softening": 0.3, "preset": None}, "material.softening: needs a preset, or a kind"),
    ],
)
def test_bad_input_gets_a_sentence(fields: dict[str, Any], sentence: str):
    with pytest.raises(InputError, match=sentence):
        Balloon(mesh=BALL, material={"preset": "latex", **fields})


def test_worlds_that_cannot_differ_say_so():
    plain = Scene(balloon=[Balloon(mesh=BALL, material=Material(preset="latex"), inflation=GAS)])
    with pytest.raises(InputError, match=r"balloon\.material\.softening: cannot differ between worlds"):
        plan_model(plain, 2, {"balloon.material.softening": [0.0, 0.3]})
