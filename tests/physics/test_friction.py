"""Friction of each pair of things: the table of docs/CONTACT.md, its updates, and a balloon's losses on a floor."""

import math
from dataclasses import replace

import numpy as np
import pytest
from conserved import after_each, motion, put
from meshes import cube
from numpy.typing import NDArray
from rigid import body_state
from touching import SLACK

from balloon_warp import Balloon, Body, Change, Ground, Inflation, Obstacle, Scene, Sphere, Stiffness, Touch, load_scene
from balloon_warp.errors import InputError
from balloon_warp.model import plan_model
from balloon_warp.model.obstacles import FRICTION
from balloon_warp.simulator import Simulator

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
    silent = Balloon(mesh=cube(), position=(0, 9, 0), inflation=SLACK)
    saying = silent.model_copy(update={"position": (3, 9, 0), "friction": 0.2})
    things = {
        "obstacle": [Obstacle(size=(0.1, 1, 1), position=(9, 2, 0), friction=0.6)],
        "sphere": [Sphere(position=(-9, 2, 0), friction=0.7)],
        "body": [Body(size=(0.1, 0.1, 0.1), position=(-5, 2, 0), friction=0.8)],
    }
    rules = {"ground": Ground(friction=0.5), "touch": Touch(friction=0.4), "contact": "impulse", "frames": 4}
    return Scene(balloon=[silent, saying], **things | rules | fields)


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


@pytest.mark.parametrize("thing", ["balloon.0", "sphere.0", "ground"])
def test_it_must_not_be_negative(thing: str):
    said = rf"{thing}\.friction: must be greater than or equal to 0 \(got -1\.0\)"
    with pytest.raises(InputError, match=said):
        load_scene(scene(), {f"{thing}.friction": -1.0})


SURFACES = {
    "ground": {"ground": Ground(friction=0.5)},
    "obstacle": {"obstacle": [Obstacle(shape="plane", friction=0.5)]},
    "body": {"body": [Body(size=(99.0, 2.0, 99.0), position=(0.0, -1.0, 0.0), mass=1e9, friction=0.5)]},
}
LOSSES = [(0.08, 0.8, 0.6), (None, 0.8, 0.3), (0.0, 0.8, 0.8), (None, 0.1, 0.0), (None, 0.4, 0.0)]
"""Friction of a balloon, its speed along the floor, and the rest of that"""


@pytest.mark.parametrize("surface", SURFACES)
def test_of_what_lands_each_loses_by_its_own(surface: str, device: str):
    """Coefficients at 1 m/s on a floor of 0.5: the root of 0.04 with 0.08 of its own; slower balloons do not turn
    back."""
    balloons = [
        Balloon(mesh=cube(), position=(3.0 * number, 0.0, 0.0), damping=0.0, inflation=SLACK, friction=own)
        for number, (own, _, _) in enumerate(LOSSES)
    ]
    still = {"gravity": 0.0, "atmosphere": {"density": 0.0}, "touch": False, "faces": False}
    simulator = Simulator(Scene(balloon=balloons, substeps=1, **still, **SURFACES[surface]), device)
    put(simulator, velocities=np.array([(speed, -1.0, 0.0) for _, speed, _ in LOSSES]).repeat(8, axis=0))
    simulator.step()
    below = np.tile(cube().points[:, 1] == 0.0, len(LOSSES))
    left = np.array([(left, 0.0, 0.0) for _, _, left in LOSSES]).repeat(4, axis=0)
    # rounding of 1 m/s, and of springs at rest: a GPU's fast roots leave them some 1e-7 too short; a body's pushes come
    # in sweeps
    exact = device == "cpu" and surface != "body"
    np.testing.assert_allclose(motion(simulator)[1][below], left, atol=1e-6 if exact else 1e-5)


TURNING, FAR_OUT = 2.0, 0.5
"""Spin of a turntable [rad/s], and where something rides on it [m]"""


@pytest.mark.always("cpu-body")
@pytest.mark.parametrize("rides", ["body", "balloon"])
def test_what_rides_on_a_turntable_keeps_its_place(rides: str, device: str):
    """A body stays for 10 s, 3 turns, within 0.1 mm of its circle and its angle, at the 8 substeps of `auto`. Along
    tangents it would go out by exp(w^2 h t / 2), 21 mm. A limp balloon slumps first, and stays after a second."""
    table = Obstacle(
        size=(8, 0.2, 8), position=(0, -0.1, 0), friction=1.0,
        motion=[(0.0, (0, 0, 0), (0, 0, 0)), (60.0, (0, 0, 0), (0, math.degrees(60.0 * TURNING), 0))],
    )  # fmt: skip
    small = replace(cube(), points=0.1 * cube().points)
    goes = {"velocity": (0, 0, -FAR_OUT * TURNING), "angular_velocity": (0, TURNING, 0), "friction": 1.0}
    balloon = {"mesh": small, "position": (FAR_OUT, 0.05, 0), "stiffness": Stiffness(structural=400.0, shear=200.0)}
    balloons = [Balloon(**balloon, damping=0.0, inflation=Inflation(pressure=0.0), **goes)]
    bodies = []
    if rides == "body":
        balloons = [Balloon(mesh=small, position=(0, 50, 0), fixed=list(range(8)))]
        bodies = [Body(size=(0.1, 0.05, 0.1), position=(FAR_OUT, 0.025, 0), mass=1.0, **goes)]
    simulator = Simulator(Scene(balloon=balloons, body=bodies, obstacle=[table], frames=600), device)

    def place(simulator: Simulator) -> NDArray[np.float64]:
        return body_state(simulator, "positions")[0] if bodies else motion(simulator)[0].mean(axis=0)

    x, _, z = np.transpose(after_each(simulator, 600, place))
    radii, angles = np.hypot(x, z), np.unwrap(np.arctan2(-z, x)) - TURNING * np.arange(1, 601) / 60.0
    begin, most = (0, 1e-4) if bodies else (60, 1e-3)
    np.testing.assert_allclose(radii[begin:], FAR_OUT if bodies else radii[begin], atol=most)
    np.testing.assert_allclose(FAR_OUT * angles[begin:], 0.0 if bodies else FAR_OUT * angles[begin], atol=most)
