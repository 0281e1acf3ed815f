"""Contact forces and friction of each pair of things; ridges, faces that meet edges and small spheres, and impacts."""

import csv
import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conserved import SLACK, advanced, after_each, motion, put, square
from meshes import cube, grid, mesh_of, quad_sphere
from numpy.typing import NDArray
from pxr import Gf, Usd
from rigid import SPACE, body_state
from scipy.spatial import ConvexHull

from balloon_warp import Atmosphere, Change, Frame, Simulator, Stiffness, animate, check_stage, run_batch
from balloon_warp.benchmarks.overlap import winding
from balloon_warp.errors import InputError
from balloon_warp.frame import Contact
from balloon_warp.mesh.topology import mesh_edges
from balloon_warp.model import plan_model
from balloon_warp.model.obstacles import FRICTION
from balloon_warp.model.touch import edge_length
from balloon_warp.scene import Balloon, Body, Ground, Inflation, Obstacle, Scene, Sphere, Touch, load_scene
from balloon_warp.schedules.gather import GatherSchedule
from balloon_warp.schedules.touch_table import round_ridges, triangles_of

GRAVITY = 9.81


def ball(height: float, **given: Any) -> Balloon:
    fine = {"mesh": quad_sphere(8, 0.5), "mass": 0.3, "inflation": Inflation(pressure=15.0)}
    return Balloon(**{"position": (0.0, height, 0.0), "damping": 4.0} | fine | given)


def at_rest(scene: Scene, frames: int = 240) -> Frame:
    return advanced(Simulator(scene.model_copy(update={"contacts": True}), device="cpu"), frames)


def on(frame: Frame, other: str, balloon: int = 0) -> Contact:
    name = frame.meshes[balloon].name
    (found,) = (each for each in frame.contacts if each.other == other and each.balloon == name)
    return found


ROD = {"name": "rod", "shape": "capsule", "radius": 0.01, "length": 3.0, "rotation": (0, 0, 90)}
FLOORS = {
    "ground": {"ground": Ground()},
    "floor": {"obstacle": [Obstacle(name="floor", size=(9.0, 1.0, 9.0), position=(0.0, -0.5, 0.0))]},
    "rod": {"obstacle": [Obstacle(position=(0, -0.01, z), **ROD) for z in (-0.1, 0.1)]},
}


@pytest.mark.always("ground")
@pytest.mark.parametrize("floor", ["ground", "floor"])
def test_what_lies_on_something_presses_it_by_its_weight(floor: str) -> None:
    contact = on(at_rest(Scene(balloon=[ball(0.5)], **FLOORS[floor])), floor)
    np.testing.assert_allclose(contact.force, (0.0, 0.3 * GRAVITY, 0.0), atol=0.03)
    np.testing.assert_allclose(contact.torque, 0.0, atol=0.02)
    assert 0.0 < contact.area < 0.3
    np.testing.assert_allclose(contact.place, 0.0, atol=0.01)  # below its middle, on the surface at height 0
    assert contact.pressure >= contact.force[1] / contact.area * 0.99


LOADS = {
    "tray": ({"body": [Body(name="tray", size=(0.8, 0.3, 0.8), position=(0.0, 1.3, 0.0), mass=0.2)]}, 0.2, 120, 0.1),
    "sphere 0": ({"sphere": [Sphere(radius=0.3, mass=0.1, position=(0.0, 1.3, 0.0))]}, 0.1, 90, 0.4),
}
"""Things on a ball, their mass [kg], frames until they rest or fall off, and how well they rest by then"""


@pytest.mark.parametrize("name", LOADS)
def test_a_thing_presses_by_its_weight_and_what_carries_it_by_both(name: str) -> None:
    things, mass, frames, rel = LOADS[name]
    setting = {"ground": Ground(), "faces": False, "contact": "impulse"}
    frame = at_rest(Scene(balloon=[ball(0.5)], **things, **setting), frames)
    assert on(frame, name).force[1] == pytest.approx(-mass * GRAVITY, rel=rel)
    if name == "tray":  # the sphere bounces on
        assert on(frame, "ground").force[1] == pytest.approx((0.3 + mass) * GRAVITY, rel=0.05)


def pile(balls: list[Balloon], half: float, **given: Any) -> Scene:
    """Return balls in a well, the upper on the lower."""
    sides = {"east": (1, 0), "west": (-1, 0), "north": (0, 1), "south": (0, -1)}
    smooth = {"shape": "plane", "friction": 0.0}
    walls = [
        Obstacle(name=name, position=(half * x, 0, half * z), rotation=(-90 * z, 0, 90 * x), **smooth)
        for name, (x, z) in sides.items()
    ]
    return Scene(balloon=balls, obstacle=walls, **{"touch": Touch(), "ground": Ground(), "contacts": True} | given)


def test_balloons_press_each_other_alike() -> None:
    pair = [ball(0.5, name="lower", friction=0.0), ball(1.52, name="upper", friction=0.0)]
    frame = at_rest(pile(pair, 0.52))
    upper, lower, ground = on(frame, "lower", 1), on(frame, "upper", 0), on(frame, "ground", 0)
    np.testing.assert_allclose(upper.force, -lower.force, rtol=1e-6, atol=1e-9)
    assert upper.force[1] == pytest.approx(0.3 * GRAVITY, rel=0.05)
    assert ground.force[1] == pytest.approx(0.6 * GRAVITY, rel=0.05)


@pytest.mark.parametrize("gap", [0.8, 0.6])
def test_the_force_on_a_plate_is_the_pressure_times_the_contact(gap: float, device: str) -> None:
    """Only the pressure acts across a cut along the contact's edge. Net forces leave contacts out, so that at rest
    those of touching particles are the plate's load. The contact ends somewhere between the particles that touch and
    their neighbors; the area that is told of it ends half an edge around those that touch."""
    soft, pressure = {"structural": 20.0, "shear": 10.0, "flexion": 0.0}, 10.0
    filled = {"pressure": [(0.0, 0.0), (0.5, pressure)]}
    pressed = Balloon(mesh=quad_sphere(12, 0.5), mass=0.5, damping=20.0, stiffness=soft, inflation=filled)
    plates = []
    for name, side in (("upper", 1.0), ("lower", -1.0)):
        motion = [(0.0, (0.0, 0.0, 0.0)), (1.0, (0.0, (0.5 * gap - 0.62) * side, 0.0))]
        place = {"size": (3.0, 0.2, 3.0), "position": (0.0, 0.72 * side, 0.0)}
        plates.append(Obstacle(name=name, friction=0.0, motion=motion, **place))
    scene = Scene(balloon=[pressed], obstacle=plates, gravity=0.0, frames=240, net_forces=True, contacts=True)
    simulator = Simulator(scene, device)
    frame = advanced(simulator, 240)
    assert np.abs(frame.velocities[0]).max() < 1e-3
    points, ends, forces = frame.points[0], mesh_edges(simulator.model.shapes[0].mesh).ends, []
    for side in (1.0, -1.0):
        touching = points[:, 1] * side > 0.5 * gap - 1e-4
        forces.append(float(frame.net_forces[0][touching, 1].sum() * side))
        around = touching.copy()
        around[ends[touching[ends].any(axis=1)]] = True
        least, most = (ConvexHull(points[which][:, [0, 2]]).volume for which in (touching, around))
        assert pressure * least < forces[-1] < pressure * most
        assert most < 1.7 * least  # or this would say little
    assert forces[0] == pytest.approx(forces[1], rel=1e-3)
    upper, lower = on(frame, "upper"), on(frame, "lower")
    np.testing.assert_allclose(upper.force, -lower.force, atol=0.02)
    assert -upper.force[1] == pytest.approx(pressure * upper.area, rel=0.15)


def test_the_stage_has_a_channel_for_each_pair(tmp_path: Path) -> None:
    scene = Scene(balloon=[ball(0.52, name="ball")], contacts=True, frames=20, **FLOORS["floor"])
    animate(scene, tmp_path / "stage.usda", device="cpu")
    stage = Usd.Stage.Open(str(tmp_path / "stage.usda"))
    prim = stage.GetPrimAtPath("/World/ball")
    forces = prim.GetAttribute("userProperties:contacts:floor:force")
    assert forces.Get(0) == Gf.Vec3d(0.0)
    assert max(forces.Get(frame)[1] for frame in range(21)) > 0.0
    assert prim.GetAttribute("userProperties:contacts:floor:area").GetNumTimeSamples() == 21


FRAMES, WORLDS = 40, 3
MASSES = {"balloon.1.mass": [0.1, 0.2, 0.4]}


def small_pile(**given: Any) -> Scene:
    """Return two coarse balls in a well."""
    coarse = {"mesh": quad_sphere(4, 0.5), "mass": 0.2, "inflation": Inflation(pressure=30.0)}
    balls = [ball(0.49, name="lower", **coarse), ball(1.45, name="upper", **coarse)]
    return pile(balls, 0.51, **{"frames": FRAMES} | given)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("out")
    run_batch(small_pile(), folder, WORLDS, MASSES, device="cpu")
    return folder


def rows_of(folder: Path) -> list[dict[str, str]]:
    return list(csv.DictReader((folder / "worlds.csv").read_text().splitlines()))


def test_a_batch_says_of_each_pair_how_hard_it_pressed(folder: Path):
    """The summary's mean and maximum are those of the frames of each world simulated alone."""
    rows = rows_of(folder)
    simulator = Simulator(small_pile(), "cpu", WORLDS, MASSES)
    frames = []
    for _ in range(FRAMES):
        simulator.step_unread()
        told = [simulator.read_frame(world).contacts for world in range(WORLDS)]
        pairs = [{(each.balloon, each.other): each for each in contacts} for contacts in told]
        frames.append([each.get(("lower", "upper")) for each in pairs])
    for row, pressed in zip(rows, zip(*frames, strict=True), strict=True):
        for name in ("force", "torque", "area"):
            values = [np.linalg.norm(getattr(each, name)) if each else 0.0 for each in pressed]
            assert float(row[f"upper_on_lower_{name}_mean"]) == pytest.approx(np.mean(values), rel=1e-4)
            assert float(row[f"upper_on_lower_{name}_max"]) == pytest.approx(max(values), rel=1e-6)
        assert float(row["upper_on_lower_pressure_max"]) == pytest.approx(max(e.pressure for e in pressed if e))
    assert not any("on_upper" in name and "lower" in name for name in rows[0])  # the same pair
    assert not any("ground_on_upper" in name for name in rows[0])  # these never touched


def test_the_manifest_says_what_the_columns_of_pairs_are(folder: Path):
    columns = json.loads((folder / "manifest.json").read_text())["columns"]
    assert columns["upper_on_lower_force_max"] == {
        "unit": "N", "meaning": "net force of upper on lower: maximum over all frames",
    }  # fmt: skip
    assert {*np.load(folder / "worlds.npz"), *np.load(folder / "table.npz")} == set(columns)


def test_nothing_is_told_or_summed_unasked():
    simulator = Simulator(small_pile(contacts=False), "cpu")
    assert simulator.state.contact_forces.shape == (1, 2, 0)
    assert simulator.read_frame().contacts == []


def test_a_world_that_began_again_has_what_it_pressed_then(tmp_path: Path):
    """The pair's force is that of a run with the later substeps: nothing is left of the frames before the blow-up."""
    vary = {"balloon.1.stiffness.structural": [30.0, 700.0]}
    rows, substeps = {}, 60
    for policy in ("freeze", "restart", "stop"):
        scene = small_pile(frames=10, substeps=substeps, solver="forward_euler")
        run_batch(scene, tmp_path / policy, 2, vary, device="cpu", on_blowup=policy)
        rows[policy] = rows_of(tmp_path / policy)
        again = json.loads((tmp_path / policy / "manifest.json").read_text()).get("restarted_worlds", {})
        substeps = again.get("1", 60)
    assert [row["health"] for row in rows["restart"]] == ["1", "2"]
    assert rows["restart"][0].items() <= rows["freeze"][0].items()  # where the blown-up world touched the ground, too
    assert rows["restart"][1] == rows["stop"][1] | {"health": "2"}
    frozen, again = (float(rows[policy][1]["upper_on_lower_force_max"]) for policy in ("freeze", "restart"))
    assert again < 0.1 * frozen


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


BLADE = mesh_of([(-1.0, -0.6, 0.0), (1.0, -0.6, 0.0), (1.0, 0.0, 0.0), (-1.0, 0.0, 0.0)], [[0, 1, 2, 3]])
THIN_ROD = {
    "shape": "capsule",
    "radius": 0.008,
    "length": 2.0,
    "rotation": (0.0, 0.0, 90.0),
    "position": (0, -0.008, 0),
}
THINGS: dict[str, dict[str, Any]] = {
    "blade": {"obstacle": [Obstacle(mesh=BLADE)]},
    "thin box": {"obstacle": [Obstacle(size=(0.005, 0.5, 2.0), position=(0.03, -0.25, 0.0))]},
    "rod": {"obstacle": [Obstacle(**THIN_ROD)]},
    "net": {
        "obstacle": [
            Obstacle(**THIN_ROD | {"rotation": (90.0, 0.0, 0.0), "position": (x, -0.008, 0.0)})
            for x in (-0.47, -0.22, 0.03, 0.28, 0.53)
        ]
    },
    "peg": {"obstacle": [Obstacle(shape="capsule", radius=0.01, length=0.5, position=(0.03, -0.26, 0.03))]},
    "corner": {"obstacle": [Obstacle(size=(0.4,) * 3, rotation=(45.0, 0.0, 35.26), position=(0.02, -0.346, 0.03))]},
    "thin body": {"body": [Body(size=(0.006, 0.5, 1.0), position=(0.02, -0.27, 0.03), mass=20.0)], "gravity": 0.0},
    "needle": {"sphere": [Sphere(radius=0.01, mass=0.2, position=(0.03, -0.02, 0.03))], "gravity": 0.0},
}
"""solids that a ball falls on, the top at a height of 0"""


def dropped_ball(cells: int, speed: float = 3.0, height: float = 0.52, **given: Any) -> Balloon:
    inflation = given.pop("inflation", Inflation(kind="pressure", pressure=15.0))
    return Balloon(
        mesh=quad_sphere(cells, 0.5), position=(0.0, height, 0.0), velocity=(0.0, -speed, 0.0), mass=0.3,
        inflation=inflation, damping=0.0, **given,
    )  # fmt: skip


@pytest.mark.parametrize("cells", [5, 9], ids=["coarse", "fine"])
@pytest.mark.parametrize("thing", THINGS)
def test_nothing_comes_in_between_particles(thing: str, cells: int, tmp_path: Path) -> None:
    scene = Scene(balloon=[dropped_ball(cells)], frames=24, faces=True, **THINGS[thing])
    animate(scene, tmp_path / "stage.usdc", device="cpu")
    # a sphere may come nearer by half its radius, see `kernels.contact.spheres`
    report = check_stage(tmp_path / "stage.usdc", within=0.006 if thing == "needle" else None)
    assert report.passed, "\n".join(str(crossing) for crossing in report.crossings[:5])


@pytest.mark.always("blade")
@pytest.mark.parametrize("thing", ["blade", "rod"])
def test_a_symmetric_drop_stays_symmetric(thing: str) -> None:
    simulator = Simulator(Scene(balloon=[dropped_ball(6)], **THINGS[thing]), device="cpu")
    frame = advanced(simulator, 40)
    middle, speed = frame.points[0].mean(axis=0), frame.velocities[0].mean(axis=0)
    assert speed[1] > 0.2  # it has bounced
    np.testing.assert_allclose(middle[[0, 2]], 0.0, atol=2e-3)
    np.testing.assert_allclose(speed[[0, 2]], 0.0, atol=0.05)


@pytest.mark.always
def test_what_was_far_away_and_begins_anew_meets_it_again() -> None:
    simulator = Simulator(Scene(balloon=[dropped_ball(5)], gravity=0.0, **THINGS["blade"]), "cpu", 1)
    found = []
    for _ in range(2):
        advanced(simulator, 8)
        found.append(simulator.state.points.numpy().copy())
        simulator.state.velocities.assign(np.broadcast_to(np.float32([0.0, 6.0, 0.0]), found[0].shape))
        advanced(simulator, 30)
        simulator.reset(np.ones(1, bool))
    np.testing.assert_array_equal(*found)


def carpet(degrees: float) -> Balloon:
    """Return a cloth of 0.2 m that lies at a height of 0, about the origin, and slides at 3 m/s."""
    turn = np.radians(degrees)
    return Balloon(
        mesh=square(5, 0.2, axis=1), mass=0.01, damping=0.0, inflation=Inflation(k_normal=0.0),
        velocity=(3.0 * np.cos(turn), 0.0, 3.0 * np.sin(turn)), rotation=(0.0, degrees, 0.0),
    )  # fmt: skip


@pytest.mark.parametrize("degrees", [0.0, 5.0, -8.0])
def test_nothing_catches_at_a_seam(degrees: float, device: str) -> None:
    places = [(0.3 * i, -0.05, 0.3 * j) for i in range(-1, 7) for j in (-1, 0, 1)]
    tiles = [Obstacle(size=(0.3, 0.1, 0.3), position=place, friction=0.0) for place in places]
    scene = Scene(balloon=[carpet(degrees)], obstacle=tiles, gravity=0.0, frames=30)
    smooth, seamed = (Simulator(scene.model_copy(update={"faces": faces}), device) for faces in (False, True))
    assert sum(len(ridges.ends) for ridges in seamed.model.ridges) > 0  # around the floor
    for simulator in (smooth, seamed):
        advanced(simulator, 30)
    frames = [simulator.read_frame() for simulator in (smooth, seamed)]
    np.testing.assert_array_equal(frames[1].points[0], frames[0].points[0])
    np.testing.assert_allclose(np.linalg.norm(frames[1].velocities[0], axis=1), 3.0, rtol=1e-3)


def exposed(obstacles: list[Obstacle], **given: Any) -> list[float]:
    """Return the exposed part of each obstacle's ridges, over the length of all of them."""
    scene = Scene(balloon=[dropped_ball(5, height=3.0)], obstacle=obstacles, faces=True, **given)
    alone = scene.model_copy(update={"obstacle": obstacles[:1], "ground": None})
    found, (whole_length, *_) = (
        [np.linalg.norm(np.diff(ridges.ends, axis=1), axis=2).sum() for ridges in plan_model(each).ridges]
        for each in (scene, alone)
    )
    return [float(length / whole_length) for length in found]


@pytest.mark.always
def test_ridges_end_where_another_solid_begins() -> None:
    """Boxes of 0.3 x 0.1 x 0.3 have 2.8 m of edges. One on the ground loses the four of its foot; two side by side lose
    the edges of the side that they share; a moving one shares nothing."""
    box = Obstacle(size=(0.3, 0.1, 0.3))
    beside = box.model_copy(update={"position": (0.3, 0.0, 0.0)})
    apart = box.model_copy(update={"position": (0.4, 0.0, 0.0)})
    moving = beside.model_copy(update={"motion": [(0.0, (0.0, 0.0, 0.0)), (1.0, (1.0, 0.0, 0.0))]})
    half = beside.model_copy(update={"position": (0.3, 0.0, 0.15)})
    small = Obstacle(size=(0.1, 0.1, 0.1), position=(0.0, 0.1, 0.0))
    assert exposed([box, apart]) == pytest.approx([1.0, 1.0])
    assert exposed([box], ground=Ground(height=-0.05)) == pytest.approx([1.6 / 2.8])
    assert exposed([box, beside]) == pytest.approx([(2.8 - 0.8) / 2.8] * 2)
    assert exposed([box, moving]) == pytest.approx([1.0, 1.0])
    shared = 2 * 0.15 + 0.1  # of the long edges a half, and the upright one in the middle of the other's side
    assert exposed([box, half]) == pytest.approx([(2.8 - shared) / 2.8] * 2, abs=2e-3)
    assert exposed([box, small]) == pytest.approx([1.0, 0.8 / 2.8])


def test_whether_faces_meet_is_yes_no_or_auto() -> None:
    scene = Scene(balloon=[dropped_ball(3)], faces=True, **THINGS["rod"])
    with pytest.raises(InputError, match="faces"):
        load_scene(scene, {"faces": "perhaps"})
    meet = []
    for turn in ((0.0, 0.0, 0.0), (0.0, 30.0, 20.0), (0.0, 0.0, 45.0), (45.0, 0.0, 35.26)):
        thick = Obstacle(size=(2.0, 2.0, 2.0), rotation=turn, position=(0.0, -3.0, 0.0))
        meet.append(bool(plan_model(Scene(balloon=[dropped_ball(6)], obstacle=[thick])).ridges))
    assert meet == [False, False, True, True]


COARSE = quad_sphere(3, 0.5)
EDGE = edge_length(COARSE)


def thrown(radius: float = 2.0 * EDGE, friction: float = 0.0, pressure: float = 0.0, **given: Any) -> Scene:
    """Return a coarse ball, and a sphere larger than its faces that flies at the middle of one of them, in space."""
    coarse = Balloon(mesh=COARSE, mass=0.3, damping=0.0, inflation=Inflation(kind="pressure", pressure=pressure))
    place = (0.56 + radius, 0.16, 0.15)
    sphere = Sphere(position=place, radius=radius, mass=0.2, velocity=(-2.0, 0.0, 0.5), friction=friction)
    return Scene(
        balloon=[coarse], sphere=[sphere], **SPACE | {"contact": "impulse", "substeps": 60, "faces": True} | given
    )


@pytest.mark.parametrize("faces", [True, False])
@pytest.mark.parametrize("start", [0.0, 0.2])
def test_flat_faces_do_not_dip_into_a_sphere(faces: bool, start: float, tmp_path: Path) -> None:
    """Faces would dip into a sphere without its ridges, by more than 0.08 of an edge; a later one, too."""
    scene = thrown(pressure=15.0, faces=faces, frames=40)
    late = scene.sphere[0].model_copy(update={"start": start})
    animate(scene.model_copy(update={"sphere": [late]}), tmp_path / "stage.usdc", device="cpu")
    crossings = check_stage(tmp_path / "stage.usdc").crossings
    assert bool(crossings) is not faces, "\n".join(str(crossing) for crossing in crossings[:5])
    assert faces or max(crossing.depth for crossing in crossings) > 0.08 * EDGE


def test_which_spheres_meet_faces_so() -> None:

    def which(**given: Any) -> list[bool]:
        return round_ridges(Simulator(thrown(**given), "cpu").model)

    rod = Obstacle(shape="capsule", radius=0.01, length=1.0, position=(0.0, -2.0, 0.0))
    assert which() == which(faces="auto", obstacle=[rod]) == [True]
    assert which(faces="auto") == which(faces=False, obstacle=[rod]) == [False]
    assert which(radius=0.3 * EDGE) == [False]  # it meets them otherwise
    assert which(contact="penalty") == [False]


RADIUS = 0.5


def flight(sphere: Sphere, contact: str = "impulse", **fields) -> Scene:
    """Return a balloon of 386 particles in space, and a sphere."""
    ball = Balloon(mesh=quad_sphere(8, RADIUS), mass=0.3, damping=0.0)
    setting = {"gravity": 0.0, "atmosphere": Atmosphere(density=0.0), "touch": Touch(), "contact": contact}
    return Scene(balloon=[ball], sphere=[sphere], **setting | fields)


def flying(mass: float = 0.05) -> Sphere:
    """Return a sphere smaller than a tenth of a face that flies at the balloon between particles."""
    return Sphere(position=(1.0, 0.022, 0.031), radius=0.004, mass=mass, velocity=(-40.0, 0.0, 0.0))


def sides_of(scene: Scene, device: str, schedule: str, frames: int) -> list[float]:
    """Return the winding numbers around the sphere's center after each frame, or each substep of `scatter`."""
    simulator = Simulator(scene, device, schedule=schedule)
    triangles = triangles_of(simulator.model.shapes[0].mesh)
    found = []
    for _ in range(frames):
        for _ in simulator.schedule.substeps(simulator.state) if schedule == "scatter" else [simulator.step()]:
            points, _ = motion(simulator)
            center = simulator.state.sphere_positions.numpy()[0, 0].astype(float)
            found.append(float(winding(center[None], points[triangles])[0]))
    return found


@pytest.mark.parametrize("speed", [0.5, 5.0, 100.0, 1000.0])
@pytest.mark.parametrize("radius", [0.0001, 0.005, 0.03])
def test_one_that_is_inside_stays_inside(radius, speed, device):
    """A substep at the highest speed would take it three times the balloon's width, and the balloon moves along."""
    ball = Sphere(position=(0.05, 0.02, 0.03), radius=radius, mass=0.05, velocity=(speed, 0.3 * speed, 0.1 * speed))
    np.testing.assert_allclose(sides_of(flight(ball), device, "scatter", frames=12), 1.0, atol=1e-3)


@pytest.mark.parametrize("contact", ["penalty", "impulse"])
@pytest.mark.parametrize("mass", [0.001, 0.05, 2.0])
def test_one_that_is_outside_stays_outside(mass, contact, device):
    ball = flying(mass=mass)
    np.testing.assert_allclose(sides_of(flight(ball, contact), device, "scatter", frames=12), 0.0, atol=1e-3)


def test_without_touch_it_flies_through(device):
    assert max(sides_of(flight(flying(), touch=None, faces=False), device, "scatter", frames=4)) > 0.9


def test_it_lies_on_a_net_that_bears_its_weight(device):
    """A net pinned at its border sags under a ball a fifth as wide as a face, in 10 seconds of slow rolling."""
    net = grid(4, 4)
    border = [n for n, point in enumerate(net.points) if point[:2].min() == 0.0 or point[:2].max() == 4.0]
    slack = Inflation(pressure=0.0)
    held = Balloon(mesh=net, scale=0.1, rotation=(-90, 0, 0), fixed=border, inflation=slack, mass=0.05, damping=0.5)
    ball = Sphere(position=(0.24, 0.1, -0.23), radius=0.01, mass=0.1)
    simulator = Simulator(Scene(balloon=[held], sphere=[ball], touch=Touch(), contact="impulse", substeps=48), device)
    assert isinstance(simulator.schedule, GatherSchedule)
    heights = after_each(simulator, 900, lambda each: float(each.state.sphere_positions.numpy()[0, 0, 1]))
    lowest = float(simulator.state.points.numpy()[0, :, 1].min())
    assert lowest < heights[-1] < lowest + 0.02  # on the lowest faces, by less than two radii of the lowest corner
    assert -0.15 < lowest < -0.05
    assert np.ptp(heights[-60:]) < 0.002
    assert np.abs(simulator.state.sphere_velocities.numpy()).max() < 0.02


def test_touch_says_that_spheres_may_be_left_alone(device):
    ball = Sphere(position=(1.0, 0.0, 0.0), radius=0.01)
    model = Simulator(flight(ball, touch=Touch(itself=True, spheres=False)), device).model
    assert model.warnings[0].startswith("sphere 0: its radius of 0.01 m fits through faces")
    assert Simulator(flight(ball), device).model.warnings == []
