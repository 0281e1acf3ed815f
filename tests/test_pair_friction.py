"""Friction of each pair of things, resolved on the host: the table of docs/CONTACT.md, and its updates."""

import math
import re
from pathlib import Path

import numpy as np
import pytest
from meshes import cube

from balloon_warp import kernels
from balloon_warp.model import plan_model
from balloon_warp.model.friction import FRICTION, SAID
from balloon_warp.scene import Balloon, Body, Change, Ground, Inflation, Obstacle, Scene, Sphere, Touch
from balloon_warp.simulator import Simulator

pytestmark = pytest.mark.physics

GROUND, WALL, BALL, BOX, SILENT, SAYING = range(6)
"""things by their numbers; of the balloons one does not say its friction"""
TABLE = {
    (SILENT, GROUND): 0.5, (SILENT, WALL): 0.6, (SILENT, BALL): 0.7, (SILENT, BOX): 0.8, (SILENT, SILENT): 0.4,
    (SAYING, GROUND): math.sqrt(0.2 * 0.5), (SAYING, WALL): math.sqrt(0.2 * 0.6), (SAYING, BALL): math.sqrt(0.2 * 0.7),
    (SAYING, BOX): math.sqrt(0.2 * 0.8), (SAYING, SAYING): 0.2, (SAYING, SILENT): math.sqrt(0.2 * 0.4),
    (BALL, GROUND): math.sqrt(0.7 * 0.5), (BALL, WALL): math.sqrt(0.7 * 0.6), (BALL, BALL): 0.7,
    (BALL, BOX): math.sqrt(0.7 * 0.8), (BOX, GROUND): math.sqrt(0.8 * 0.5), (BOX, WALL): math.sqrt(0.8 * 0.6),
    (BOX, BOX): 0.8,
}  # fmt: skip
"""Coulomb's coefficient of each pair, as the documentation says"""


def scene(**fields) -> Scene:
    balloons = [
        Balloon(mesh=cube(), position=(0, 9, 0), inflation=Inflation(pressure=0.0)),
        Balloon(mesh=cube(), position=(3, 9, 0), inflation=Inflation(pressure=0.0), friction=0.2),
    ]
    things = {
        "ground": Ground(friction=0.5),
        "obstacle": [Obstacle(size=(0.1, 1, 1), position=(9, 2, 0), friction=0.6)],
        "sphere": [Sphere(position=(-9, 2, 0), friction=0.7)],
        "body": [Body(size=(0.1, 0.1, 0.1), position=(-5, 2, 0), friction=0.8)],
        "touch": Touch(friction=0.4),
        "contact": "impulse",
        "frames": 4,
    }
    return Scene(balloon=balloons, **{**things, **fields})


def coefficients(simulator: Simulator) -> np.ndarray:
    """Return the coefficients that kernels read, shape (W, thing_count, thing_count)."""
    return simulator.model.parameters[FRICTION].numpy()


def test_each_pair_has_the_coefficient_of_the_documented_table():
    (frictions,) = plan_model(scene()).parameters[FRICTION]
    for (first, second), expected in TABLE.items():
        assert frictions[first, second] == pytest.approx(expected, rel=1e-7), (first, second)
    np.testing.assert_array_equal(frictions, frictions.T)


@pytest.mark.parametrize(
    ("path", "pair", "value", "expected"),
    [
        ("ground.friction", (SILENT, GROUND), 0.1, 0.1),
        ("obstacle.0.friction", (SAYING, WALL), 0.8, 0.4),
        ("sphere.0.friction", (BALL, BALL), 0.3, 0.3),
        ("body.0.friction", (BOX, GROUND), 0.02, 0.1),
        ("touch.friction", (SILENT, SAYING), 0.8, 0.4),
        ("balloon.1.friction", (SAYING, GROUND), 0.02, 0.1),
    ],
)
def test_pairs_follow_what_changes(path: str, pair: tuple[int, int], value: float, expected: float):
    """Pairs follow a coefficient that varies between worlds, is planned or set, alike or by world; all else stays."""
    varied = plan_model(scene(), 2, {path: [0.5, value]}).parameters[FRICTION]
    assert varied[:, *pair][1] == pytest.approx(expected, rel=1e-6)
    planned = Simulator(scene(change=[Change(time=1 / 60, set={path: value})]), "cpu")
    before = coefficients(planned).copy()
    planned.frame_number = 1
    planned.make_due_changes()
    assert coefficients(planned)[0, *pair] == pytest.approx(expected, rel=1e-6)
    kept = np.ones_like(before, dtype=bool)
    kept[:, list(pair)], kept[:, :, list(pair)] = False, False
    np.testing.assert_array_equal(coefficients(planned)[kept], before[kept])
    batch = Simulator(scene(), "cpu", 2, {"balloon.mass": [1.0, 2.0]})
    batch.set({path: value})
    np.testing.assert_allclose(coefficients(batch)[:, *pair], expected, rtol=1e-6)
    batch.set({path: [0.0, value]})
    np.testing.assert_allclose(coefficients(batch)[:, *pair], [0.0, expected], rtol=1e-6)


def test_kernels_read_the_resolved_coefficient_alone():
    """Kernels read the resolved coefficient alone: none reads a thing's own, and none takes a mean. An adjoint names
    the column into which it sums a derivative, and reads none."""
    said = re.compile("|".join(f'"{name}"' for name in SAID))
    read = re.compile(r"params\.n\[friction_column\]")
    folder = Path(kernels.__file__).parent
    for path in folder.rglob("*.py"):
        if path.parent.name != "laws":  # where the parameters are listed
            text = path.read_text()
            if path.parent.name == "adjoints":
                assert not read.search(text), path
                text = text.replace('features.columns.places["balloon_friction"]', "")
            assert not said.search(text), path
