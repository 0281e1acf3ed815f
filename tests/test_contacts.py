"""Contact forces of each pair of things, averaged over a frame."""

from pathlib import Path

import numpy as np
import pytest
from meshes import quad_sphere
from pxr import Gf, Usd

from balloon_warp.contacts import Contact
from balloon_warp.frame import Frame
from balloon_warp.job import animate
from balloon_warp.scene import Balloon, Body, Ground, Inflation, Obstacle, Scene, Sphere, Touch, load_scene
from balloon_warp.simulator import Simulator

pytestmark = pytest.mark.physics

GRAVITY = 9.81


def ball(height: float, **given) -> Balloon:
    return Balloon(
        mesh=quad_sphere(8, 0.5), position=(0.0, height, 0.0), mass=0.3, damping=4.0,
        inflation=Inflation(kind="pressure", pressure=15.0), **given,
    )  # fmt: skip


def at_rest(scene: Scene, frames: int = 240) -> Frame:
    simulator = Simulator(scene.model_copy(update={"contacts": True, "frames": frames}), device="cpu")
    for _ in range(frames):
        simulator.step_unread()
    return simulator.read_frame()


def on(frame: Frame, other: str, balloon: int = 0) -> Contact:
    name = frame.meshes[balloon].name
    (found,) = (each for each in frame.contacts if each.other == other and each.balloon == name)
    return found


FLOORS = {
    "ground": {"ground": Ground()},
    "floor": {"obstacle": [Obstacle(name="floor", size=(9.0, 1.0, 9.0), position=(0.0, -0.5, 0.0))]},
    "rod": {
        "obstacle": [
            Obstacle(name="rod", shape="capsule", radius=0.01, length=3.0, position=(0, -0.01, z), rotation=(0, 0, 90))
            for z in (-0.1, 0.1)
        ]
    },
}


@pytest.mark.parametrize("floor", ["ground", "floor"])
def test_what_lies_on_something_presses_it_by_its_weight(floor: str) -> None:
    contact = on(at_rest(Scene(balloon=[ball(0.5)], **FLOORS[floor])), floor)
    np.testing.assert_allclose(contact.force, (0.0, 0.3 * GRAVITY, 0.0), atol=0.03)
    np.testing.assert_allclose(contact.torque, 0.0, atol=0.02)
    assert 0.0 < contact.area < 0.3
    np.testing.assert_allclose(contact.place, 0.0, atol=0.01)  # below its middle, on the surface at height 0
    assert contact.pressure >= contact.force[1] / contact.area * 0.99


@pytest.mark.full
def test_what_is_held_by_ridges_counts() -> None:
    """Contact forces include those by ridges: a ball on two rods, which bear it between its particles, too."""
    frame = at_rest(Scene(balloon=[ball(0.49, friction=0.0)], faces=True, **FLOORS["rod"]))
    total = sum(each.force for each in frame.contacts)
    np.testing.assert_allclose(total, (0.0, 0.3 * GRAVITY, 0.0), atol=0.1)
    assert {each.other for each in frame.contacts} == {"rod"}


@pytest.mark.full
def test_a_body_presses_by_its_weight_and_what_carries_it_by_both() -> None:
    tray = Body(name="tray", size=(0.8, 0.3, 0.8), position=(0.0, 1.3, 0.0), mass=0.2)
    frame = at_rest(Scene(balloon=[ball(0.5)], body=[tray], ground=Ground(), faces=False), 120)
    assert on(frame, "tray").force[1] == pytest.approx(-0.2 * GRAVITY, rel=0.1)
    assert on(frame, "ground").force[1] == pytest.approx(0.5 * GRAVITY, rel=0.05)


@pytest.mark.full
def test_balloons_press_each_other_alike() -> None:
    """Forces between two balloons are equal and opposite: the upper lies on the lower, in a pit of four walls."""
    walls = [
        Obstacle(shape="plane", position=position, rotation=turn)
        for position, turn in (
            ((0.52, 0, 0), (0, 0, 90)), ((-0.52, 0, 0), (0, 0, -90)),
            ((0, 0, 0.52), (-90, 0, 0)), ((0, 0, -0.52), (90, 0, 0)),
        )
    ]  # fmt: skip
    pair = [ball(0.5, name="lower", friction=0.0), ball(1.52, name="upper", friction=0.0)]
    frame = at_rest(Scene(balloon=pair, ground=Ground(), obstacle=walls, touch=Touch()))
    upper = next(each for each in frame.contacts if (each.balloon, each.other) == ("upper", "lower"))
    lower = next(each for each in frame.contacts if (each.balloon, each.other) == ("lower", "upper"))
    np.testing.assert_allclose(upper.force, -lower.force, rtol=1e-6, atol=1e-9)
    assert upper.force[1] == pytest.approx(0.3 * GRAVITY, rel=0.05)
    ground = next(each for each in frame.contacts if (each.balloon, each.other) == ("lower", "ground"))
    assert ground.force[1] == pytest.approx(0.6 * GRAVITY, rel=0.05)


def test_the_press_presses_by_pressure_times_area() -> None:
    """A plate presses with F = dp A at a film's pressure, by reported contacts alone, on a balloon that lies flat."""
    soft = {"structural": 20.0, "shear": 10.0, "flexion": 0.0}
    filled = {"pressure": [(0.0, 0.0), (0.5, 10.0)]}
    pressed = Balloon(mesh=quad_sphere(12, 0.5), mass=0.5, damping=20.0, stiffness=soft, inflation=filled)
    plates = [
        Obstacle(
            name=name, size=(3.0, 0.2, 3.0), position=(0.0, 0.72 * side, 0.0), friction=0.0,
            motion=[(0.0, (0.0, 0.0, 0.0)), (1.0, (0.0, -0.32 * side, 0.0))],
        )
        for name, side in (("upper", 1.0), ("lower", -1.0))
    ]  # fmt: skip
    frame = at_rest(Scene(balloon=[pressed], obstacle=plates, gravity=0.0))
    upper, lower = on(frame, "upper"), on(frame, "lower")
    np.testing.assert_allclose(upper.force, -lower.force, atol=0.02)
    # the area of particles ends half an edge around those that touch
    assert -upper.force[1] == pytest.approx(10.0 * upper.area, rel=0.15)


@pytest.mark.full
def test_the_bundled_press_tells_force_as_pressure_times_area() -> None:
    """The bed bears F = dp A while the plate holds still, with dp the paper's push over the area of the skin."""
    simulator = Simulator(load_scene("press", {"contacts": True}), device="cpu")
    for _ in range(71):
        simulator.step_unread()
    frame = simulator.read_frame()
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


@pytest.mark.full
def test_a_sphere_presses() -> None:
    sphere = Sphere(radius=0.3, mass=0.1, position=(0.0, 1.3, 0.0))
    frame = at_rest(Scene(balloon=[ball(0.5)], sphere=[sphere], ground=Ground(), contact="impulse"), 90)
    assert on(frame, "sphere 0").force[1] == pytest.approx(-0.1 * GRAVITY, rel=0.4)


def test_nothing_is_told_unasked() -> None:
    simulator = Simulator(Scene(balloon=[ball(0.5)], ground=Ground()), device="cpu")
    assert simulator.step().contacts == []
