"""Ridges: faces of balloons that meet edges, corners, thin things and spheres between their particles."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conserved import advanced, after_each, energy
from meshes import mesh_of, quad_sphere
from rigid import SPACE
from touching import square

from balloon_warp import InputError, Simulator, animate, check_stage, load_scene
from balloon_warp.model.plan import plan_model
from balloon_warp.model.touch import edge_length
from balloon_warp.scene import Balloon, Body, Ground, Inflation, Obstacle, Scene, Sphere
from balloon_warp.schedules.touch_table import round_ridges

BLADE = mesh_of([(-1.0, -0.6, 0.0), (1.0, -0.6, 0.0), (1.0, 0.0, 0.0), (-1.0, 0.0, 0.0)], [[0, 1, 2, 3]])
ROD = {"shape": "capsule", "radius": 0.008, "length": 2.0, "rotation": (0.0, 0.0, 90.0), "position": (0, -0.008, 0)}
THINGS: dict[str, dict[str, Any]] = {
    "blade": {"obstacle": [Obstacle(mesh=BLADE)]},
    "thin box": {"obstacle": [Obstacle(size=(0.005, 0.5, 2.0), position=(0.03, -0.25, 0.0))]},
    "rod": {"obstacle": [Obstacle(**ROD)]},
    "net": {
        "obstacle": [
            Obstacle(**ROD | {"rotation": (90.0, 0.0, 0.0), "position": (x, -0.008, 0.0)})
            for x in (-0.47, -0.22, 0.03, 0.28, 0.53)
        ]
    },
    "peg": {"obstacle": [Obstacle(shape="capsule", radius=0.01, length=0.5, position=(0.03, -0.26, 0.03))]},
    "corner": {"obstacle": [Obstacle(size=(0.4,) * 3, rotation=(45.0, 0.0, 35.26), position=(0.02, -0.346, 0.03))]},
    "thin body": {"body": [Body(size=(0.006, 0.5, 1.0), position=(0.02, -0.27, 0.03), mass=20.0)], "gravity": 0.0},
    "needle": {"sphere": [Sphere(radius=0.01, mass=0.2, position=(0.03, -0.02, 0.03))], "gravity": 0.0},
}
"""solids that a ball falls on, the top at a height of 0"""


def ball(cells: int, speed: float = 3.0, height: float = 0.52, **given: Any) -> Balloon:
    inflation = given.pop("inflation", Inflation(kind="pressure", pressure=15.0))
    return Balloon(
        mesh=quad_sphere(cells, 0.5), position=(0.0, height, 0.0), velocity=(0.0, -speed, 0.0), mass=0.3,
        inflation=inflation, damping=0.0, **given,
    )  # fmt: skip


@pytest.mark.parametrize("cells", [5, 9], ids=["coarse", "fine"])
@pytest.mark.parametrize("thing", THINGS)
def test_nothing_comes_in_between_particles(thing: str, cells: int, tmp_path: Path) -> None:
    scene = Scene(balloon=[ball(cells)], frames=24, faces=True, **THINGS[thing])
    animate(scene, tmp_path / "stage.usdc", device="cpu")
    # a sphere may come nearer by half its radius, see `kernels.contact.spheres`
    report = check_stage(tmp_path / "stage.usdc", within=0.006 if thing == "needle" else None)
    assert report.passed, "\n".join(str(crossing) for crossing in report.crossings[:5])


def test_a_blade_cuts_a_ball_whose_faces_do_not_meet_it(tmp_path: Path) -> None:
    """A blade cuts a ball without contact of faces, as the other tests require."""
    scene = Scene(balloon=[ball(5)], frames=24, faces=False, **THINGS["blade"])
    animate(scene, tmp_path / "stage.usdc", device="cpu")
    assert max(crossing.depth for crossing in check_stage(tmp_path / "stage.usdc").crossings) > 0.1


@pytest.mark.always
@pytest.mark.parametrize("thing", ["blade", "rod"])
def test_a_symmetric_drop_stays_symmetric(thing: str) -> None:
    simulator = Simulator(Scene(balloon=[ball(6)], **THINGS[thing]), device="cpu")
    frame = advanced(simulator, 40)
    middle, speed = frame.points[0].mean(axis=0), frame.velocities[0].mean(axis=0)
    assert speed[1] > 0.2  # it has bounced
    np.testing.assert_allclose(middle[[0, 2]], 0.0, atol=2e-3)
    np.testing.assert_allclose(speed[[0, 2]], 0.0, atol=0.05)


@pytest.mark.parametrize("friction", [0.0, 0.6])
@pytest.mark.parametrize("thing", ["blade", "net", "corner"])
def test_energy_never_grows(thing: str, friction: float) -> None:
    none = Inflation(kind="pressure", pressure=0.0)
    rough = [each.model_copy(update={"friction": friction}) for each in THINGS[thing]["obstacle"]]
    thrown = ball(6, inflation=none, angular_velocity=(0.0, 0.0, 2.0))
    scene = Scene(balloon=[thrown], gravity=0.0, substeps=160, faces=True, obstacle=rough)
    simulator = Simulator(scene, device="cpu")
    energies = np.array([energy(simulator), *after_each(simulator, 30, energy)])
    least = np.minimum.accumulate(energies)
    assert (energies[1:] < least[:-1] * (1.0 + 1e-3)).all()  # which a step of symplectic Euler is off by
    assert least[-1] < 0.95 * energies[0]  # it has met something


@pytest.mark.always
def test_what_was_far_away_and_begins_anew_meets_it_again() -> None:
    simulator = Simulator(Scene(balloon=[ball(5)], gravity=0.0, **THINGS["blade"]), "cpu", 1)
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
    scene = Scene(balloon=[ball(5, height=3.0)], obstacle=obstacles, faces=True, **given)
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
    scene = Scene(balloon=[ball(3)], faces=True, **THINGS["rod"])
    with pytest.raises(InputError, match="faces"):
        load_scene(scene, {"faces": "perhaps"})
    meet = []
    for turn in ((0.0, 0.0, 0.0), (0.0, 30.0, 20.0), (0.0, 0.0, 45.0), (45.0, 0.0, 35.26)):
        thick = Obstacle(size=(2.0, 2.0, 2.0), rotation=turn, position=(0.0, -3.0, 0.0))
        meet.append(bool(plan_model(Scene(balloon=[ball(6)], obstacle=[thick])).ridges))
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
