"""Pieces of a burst balloon: skin that keeps its size, and comes to rest on the ground."""

from typing import Any

import numpy as np
import pytest
from meshes import quad_sphere
from numpy.typing import NDArray

from balloon_warp.errors import InputError
from balloon_warp.frame import Frame
from balloon_warp.scene import Balloon, Ground, Inflation, Material, Scene, Stiffness
from balloon_warp.schedules.choose import LAUNCHED
from balloon_warp.simulator import Simulator

pytestmark = pytest.mark.physics

BALL = quad_sphere(6, 0.035)
PIERCED = 0.07
KINDS = ["structural", "shear", "flexion"]
STRUTS = {"structural": 20.0, "shear": 10.0, "flexion": 5.0, "yield_stretch": 1.0, "viscosity": 1e-4}


def scene_of(springs: list[str], stiffness: dict[str, float], **fields: Any) -> Scene:
    """Return a toy balloon, pumped up and pierced, above the ground."""
    material = Material(preset="latex", strength=2.0e7, needle_time=PIERCED, springs=springs)
    pumped = Inflation(kind="gas", molar_mass=0.029, pump=[[0.0, 3.3], [0.06, 3.3], [0.065, 0.0]])
    balloon = Balloon(
        mesh=BALL,
        position=(0, 0.12, 0),
        material=material,
        stiffness=Stiffness(**stiffness),
        inflation=pumped,
        damping=0.02,
        drag_coefficient=0.47,
    )
    return Scene(balloon=[balloon], ground=Ground(), frames_per_second=100, **fields)


def skin_left(simulator: Simulator, frame: Frame) -> float:
    """Return the area of whole faces over that at rest."""
    membrane = simulator.model.shapes[0].membrane
    whole = ~frame.torn[0][membrane.faces]
    now, at_rest = (_areas(edges)[whole] for edges in (_edges(frame.points[0], membrane.corners), membrane.edges))
    return float((now * membrane.areas[whole] / at_rest).sum() / membrane.areas[whole].sum())


def _edges(points: NDArray[np.floating], corners: NDArray[np.int64]) -> NDArray[np.floating]:
    return points[corners[:, 1:]].astype(np.float64) - points[corners[:, :1]]


def _areas(edges: NDArray[np.floating]) -> NDArray[np.floating]:
    return np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1)


@pytest.fixture(scope="module")
def settled() -> Simulator:
    """Return a simulator two seconds after the burst: the rolling of pieces, and so its time, is chaotic."""
    simulator = Simulator(scene_of(KINDS, STRUTS), "cpu")
    for _ in range(210):
        simulator.step()
    return simulator


@pytest.mark.full
def test_pieces_stay_skin_and_lie_still(settled: Simulator):
    """Pieces are as large as at rest, on the ground and not in it, no flatter than skin bends, and motionless."""
    frame = settled.read_frame()
    assert frame.torn[0].any()
    assert skin_left(settled, frame) == pytest.approx(1.0, abs=0.05)
    heights = frame.points[0][:, 1]
    assert heights.min() == pytest.approx(0.0, abs=1e-3)
    assert 0.01 < heights.max() < 0.08
    middle = settled.model.shapes[0].mass_share @ frame.points[0]
    settled.step()
    later = settled.read_frame()
    assert np.linalg.norm(settled.model.shapes[0].mass_share @ later.points[0] - middle) < 1e-4
    assert np.linalg.norm(later.points[0] - frame.points[0], axis=1).max() < 1e-3, "within a hundredth of a second"


@pytest.mark.full
def test_struts_do_not_hold_the_balloon_or_its_tear():
    """Struts change neither the balloon before it is pierced nor the tear."""
    tears = []
    for springs, stiffness in (([], {}), (KINDS, STRUTS)):
        simulator = Simulator(scene_of(springs, stiffness), "cpu")
        for _ in range(7):
            simulator.step()
        full = simulator.read_frame()
        simulator.step()
        tears.append((full, int(simulator.read_frame().torn[0].sum())))
    (plain, torn), (held, torn_too) = tears
    np.testing.assert_allclose(held.volumes, plain.volumes, rtol=1e-3)
    assert torn_too == pytest.approx(torn, rel=0.15)


@pytest.mark.full
def test_schedules_agree_on_struts(device: str):
    """Schedules agree on struts, pumped, and until the tear is some faces long."""
    results = []
    for schedule in LAUNCHED:
        simulator = Simulator(scene_of(KINDS, STRUTS), device, schedule=schedule)
        for _ in range(7):
            simulator.step()
        results.append(simulator.read_frame().points[0])
    np.testing.assert_allclose(*results, atol=1e-4)


@pytest.mark.parametrize(
    ("stiffness", "fields", "sentence"),
    [
        ({}, {}, "springs: pull, and would hold a tear together; expected stiffness.yield_stretch = 1"),
        ({"yield_stretch": 1.5}, {}, "springs: pull, and would hold a tear together; expected"),
        (
            {"yield_stretch": 1.0},
            {"correction": "provot"},
            "correction: shortens springs of balloon 0, whose material tears",
        ),
    ],
)
def test_springs_that_pull_get_a_sentence(stiffness: dict[str, float], fields: dict[str, Any], sentence: str):
    with pytest.raises(InputError, match=sentence):
        Simulator(scene_of(["structural"], stiffness, **fields), "cpu")
