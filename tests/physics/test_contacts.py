"""Contact forces of each pair of things, averaged over a frame: in frames, on the device, and of a batch."""

import csv
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from batches import OFTEN, press_ctrl_c_once
from conserved import advanced
from meshes import quad_sphere
from pxr import Gf, Usd
from scipy.spatial import ConvexHull

from balloon_warp import Cluster, Frame, Simulator, animate, run_batch
from balloon_warp.frame import Contact
from balloon_warp.mesh.topology import mesh_edges
from balloon_warp.scene import Balloon, Body, Ground, Inflation, Obstacle, Scene, Sphere, Touch, load_scene

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


def test_what_is_held_by_ridges_counts() -> None:
    frame = at_rest(Scene(balloon=[ball(0.49, friction=0.0)], faces=True, **FLOORS["rod"]))
    total = sum(each.force for each in frame.contacts)
    np.testing.assert_allclose(total, (0.0, 0.3 * GRAVITY, 0.0), atol=0.1)
    assert {each.other for each in frame.contacts} == {"rod"}


LOADS = {
    "tray": ({"body": [Body(name="tray", size=(0.8, 0.3, 0.8), position=(0.0, 1.3, 0.0), mass=0.2)]}, 0.2, 120, 0.1),
    "sphere 0": ({"sphere": [Sphere(radius=0.3, mass=0.1, position=(0.0, 1.3, 0.0))]}, 0.1, 90, 0.4),
}
"""Things on a ball, their mass [kg], frames until they rest or fall off, and how well they rest by then"""


@pytest.mark.always("tray")
@pytest.mark.parametrize("name", ["tray", pytest.param("sphere 0", marks=pytest.mark.full)])
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


def test_the_bundled_press_tells_force_as_pressure_times_area() -> None:
    """The bed bears F = dp A while the plate holds still, with dp the paper's push over the area of the skin."""
    simulator = Simulator(load_scene("press", {"contacts": True}), device="cpu")
    frame = advanced(simulator, 71)
    pushes = np.linalg.norm(frame.inflation_forces[0], axis=1).sum()
    plate, bed = on(frame, "plate"), on(frame, "bed")
    assert bed.force[1] == pytest.approx(pushes / frame.areas[0] * bed.area, rel=0.06)
    assert -plate.force[1] == pytest.approx(bed.force[1], rel=0.3)  # it still moves, and has a weight and a lift
    assert plate.pressure > pushes / frame.areas[0]


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


def test_a_stopped_batch_goes_on_to_the_same_columns(folder: Path, tmp_path: Path):
    how = {"device": "cpu", "checkpoint_seconds": OFTEN, "resume": True}
    with pytest.raises(KeyboardInterrupt):
        run_batch(small_pile(), tmp_path, WORLDS, MASSES, **how, on_frame=press_ctrl_c_once(lambda frame: frame == 25))
    run_batch(small_pile(), tmp_path, WORLDS, MASSES, **how)
    assert (tmp_path / "worlds.csv").read_bytes() == (folder / "worlds.csv").read_bytes()


def test_nothing_is_told_or_summed_unasked():
    simulator = Simulator(small_pile(contacts=False), "cpu")
    assert simulator.state.contact_forces.shape == (1, 2, 0)
    assert simulator.read_frame().contacts == []


def test_a_cluster_tells_the_same(folder: Path, tmp_path: Path):
    run_batch(small_pile(), tmp_path, WORLDS, MASSES, cluster=Cluster(workers=2))
    assert (tmp_path / "worlds.csv").read_bytes() == (folder / "worlds.csv").read_bytes()


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
