"""Free rigid bodies: how they turn, bounce, slide, stand and lean; and what no impact of things in space changes."""

from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
import trimesh
import warp as wp
from conserved import collision, masses, most_in, motion, sphere_momenta, sphere_spins
from meshes import cube, fans, grid, joined, prism, quad_sphere, torus
from numpy.typing import NDArray
from pxr import Usd, UsdGeom
from rigid import EPSILON, SPACE, body_energy, body_masses, body_state, kinetic, moved, scene_of, started, whole
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation
from trajectories import played, stepped

from balloon_warp import Touch, run_batch
from balloon_warp.errors import InputError
from balloon_warp.mesh.load import place_mesh
from balloon_warp.mesh.surface_nets import MeshDistance
from balloon_warp.model.obstacles import shape_body
from balloon_warp.model.plan import plan_model
from balloon_warp.model.touch import edge_length
from balloon_warp.scene import Balloon, Body, Ground, Inflation, Obstacle, Scene, Sphere
from balloon_warp.simulator import Simulator

TOP = Body(size=(0.6, 0.3, 0.15), mass=2.0, angular_velocity=(1.5, 8.0, 0.5))
"""one that turns about its middle axis, and so tumbles"""


def tumbled(device: str, substeps: int, frames: int = 100) -> tuple[float, NDArray[np.float64]]:
    """Return the largest error of the energy, over the energy, and the turn in the end."""
    simulator = started(device, TOP, **SPACE, substeps=substeps)
    energy, momenta, worst = kinetic(simulator), body_state(simulator, "momenta"), 0.0
    for _ in range(frames):
        simulator.step()
        worst = max(worst, abs(kinetic(simulator) - energy))
        np.testing.assert_array_equal(body_state(simulator, "momenta"), momenta)  # these are kept
    return worst / energy, body_state(simulator, "turns")[0]


def exact_turn(seconds: float) -> Rotation:
    """Return the turn of the top in the end, by Euler's equations in float64."""
    inertia = 2.0 * shape_body(0, TOP, scene_of(TOP)).inertia
    momentum = inertia @ TOP.angular_velocity

    def slope(_time: float, turn: NDArray[np.float64]) -> NDArray[np.float64]:
        rotation = Rotation.from_quat(turn)
        spin = rotation.apply(np.linalg.solve(inertia, rotation.inv().apply(momentum)))
        return 0.5 * np.append(spin * turn[3] + np.cross(spin, turn[:3]), -spin @ turn[:3])

    solved = solve_ivp(slope, (0.0, seconds), (0.0, 0.0, 0.0, 1.0), rtol=1e-11, atol=1e-12)
    return Rotation.from_quat(solved.y[:, -1])


def test_an_asymmetric_top_tumbles_and_keeps_angular_momentum_and_energy(device):
    """The turn converges at second order: half the step makes a quarter of the error. Energy stays at any step. The top
    turns about its middle axis, which is unstable: it has turned over by then."""
    errors, turns = zip(*[tumbled(device, substeps) for substeps in (1, 2, 4)], strict=True)
    exact = exact_turn(1.0)
    off = [(Rotation.from_quat(turn) * exact.inv()).magnitude() for turn in turns]
    for coarse, fine in ((0, 1), (1, 2)):
        assert 3.0 < off[coarse] / off[fine] < 5.0
    assert max(errors) < 1e-5
    assert off[0] < 0.01
    middle = [Rotation.from_quat(tumbled(device, 4, frames)[1]).apply((0, 1, 0))[1] for frames in (40, 60, 80, 100)]
    assert min(middle) < 0.0


@pytest.mark.always
def test_inertia_is_that_of_the_solid():
    """Inertia of boxes, capsules and meshes about their centers of mass agrees with trimesh's; a sheet's is that of a
    plate."""
    bent = quad_sphere(4, 0.5)
    bent = replace(bent, points=bent.points * (1.0, 0.5, 0.3) + (2.0, 1.0, -1.0))
    scene = scene_of(
        Body(size=(1.0, 2.0, 3.0)), Body(radius=0.2, length=0.7), Body(mesh=bent), Body(mesh=grid(3, 2), thickness=0.01)
    )
    shapes = [shape_body(number, body, scene) for number, body in enumerate(scene.body)]
    box = trimesh.creation.box((1.0, 2.0, 3.0))
    capsule = trimesh.creation.capsule(0.7, 0.2, count=[256, 256])
    capsule.apply_transform(trimesh.transformations.rotation_matrix(np.pi / 2, (1, 0, 0)))
    solid = trimesh.Trimesh(bent.points, shapes[2].solid.triangles)
    for shape, expected, tolerance in zip(shapes, (box, capsule, solid), (1e-12, 1e-3, 1e-9), strict=False):
        assert shape.volume == pytest.approx(expected.volume, rel=tolerance)
        np.testing.assert_allclose(
            shape.inertia, expected.moment_inertia / expected.mass, rtol=tolerance, atol=tolerance
        )
    np.testing.assert_allclose(shapes[2].center, solid.center_mass)
    np.testing.assert_allclose(np.diag(shapes[3].inertia), (2**2 / 12, 3**2 / 12, (2**2 + 3**2) / 12))
    assert shapes[3].volume == pytest.approx(3 * 2 * 0.02)


def test_density_says_what_it_weighs(device):
    simulator = started(device, Body(size=(0.1, 0.2, 0.3), density=500.0), Body(size=(1, 1, 1), position=(5, 0, 0)))
    np.testing.assert_allclose(body_masses(simulator), (3.0, 1.0), rtol=EPSILON)


@pytest.mark.parametrize(
    ("fields", "sentence"),
    [
        ({"mass": 0.0}, "body.mass: "),
        ({"mass": 1.0, "density": 2.0}, "density: must be left out where mass is given"),
        ({"shape": "plane"}, "body.shape: "),
        ({"mesh": grid(2, 2)}, r"body.0.thickness: is missing, and \w+ is not closed"),
        ({"position": (0, 0.2, 0)}, "body.0.position: it starts 0.3 m deep inside the ground"),
        ({"position": (5.0, 1.0, 0)}, "body.0.position: it starts .* m deep inside obstacle 0"),
        ({"position": (0.2, 3.0, 0)}, r"balloon.0.position: \w+ starts .* m deep inside body 0"),
        ({"position": (-5.0, 2.0, 0)}, "sphere.0.position: it starts .* m deep inside body 0"),
    ],
)
def test_nonsense_gets_one_sentence(fields, sentence):
    inside = Balloon(mesh=quad_sphere(4, 0.5), position=(0, 3.0, 0))
    table = Obstacle(size=(1, 1, 1), position=(5, 1, 0))
    ball = Sphere(position=(-5, 2, 0), radius=0.3)

    things = {"balloon": [inside], "obstacle": [table], "sphere": [ball], "ground": Ground()}
    with pytest.raises(InputError, match=sentence) as refused:
        Simulator(Scene(body=[Body(**{"position": (0, 7.0, 0)} | fields)], **things), "cpu")
    assert "\n" not in str(refused.value)


FALL = 0.9
"""[m]"""


def tops(simulator: Simulator, seconds: float, rest: float) -> list[float]:
    """Return the apex of a body after each bounce, above where it rests [m]: of each flight the frame nearest to its
    top, less than a hundredth of a second from there, and the rest of the way there, v^2 / 2 g."""
    found, best, before = [], (np.inf, 0.0), 0.0
    for _ in range(round(seconds * 60.0)):
        simulator.step()
        height, speed = body_state(simulator, "positions")[0, 1] - rest, body_state(simulator, "velocities")[0, 1]
        if speed > before:  # it has bounced
            found.append(best[1])
            best = (np.inf, 0.0)
        best = min(best, (abs(speed), height + speed**2 / (2.0 * 9.81)))
        before = speed
    return found


def bouncing(device: str, floor: str, restitution: float, **fields: Any) -> Simulator:
    """Return a ball that falls on the ground, or a box on something."""
    ball = Body(radius=0.1, length=0.0, position=(0, FALL + 0.1, 0), restitution=restitution)
    brick = Body(size=(0.3, 0.2, 0.3), position=(0, FALL + 0.1, 0), restitution=restitution)
    table = Obstacle(size=(9, 1, 9), position=(0, -0.5, 0), restitution=restitution)
    setting: dict[str, Any] = {"gravity": 9.81, "frames_per_second": 60.0}
    if floor == "obstacle":
        return started(device, brick, obstacle=[table], **setting | fields)
    return started(device, ball, ground=Ground(restitution=restitution), **setting | fields)


@pytest.mark.always("cpu-ground-0.3-1")
@pytest.mark.parametrize("substeps", ["auto", 1, 13, 64])
@pytest.mark.parametrize("restitution", [0.3, 0.7, 1.0])
@pytest.mark.parametrize("floor", ["ground", "obstacle"])
def test_each_bounce_comes_back_to_the_square_of_the_restitution(floor, restitution, substeps, device):
    """Each apex is e^2 of the one before, within 2 %. The step conserves its own energy, off by g h v / 2 from the one
    measured, so apexes lower than a step's fall are left out."""
    found = tops(bouncing(device, floor, restitution, substeps=substeps), 2.5, 0.1)
    expected = FALL * restitution ** (2 * np.arange(len(found)))
    told = expected > (0.05 if substeps == 1 else 0.005)
    assert told.sum() >= 2
    np.testing.assert_allclose(np.array(found)[told], expected[told], rtol=0.02)


BRICK, PLATE, ROD = (0.2, 0.3, 0.15), (0.3, 0.3, 0.02), (0.04, 0.4, 0.04)
"""Sizes of boxes [m]"""


@pytest.mark.always("cpu-brick-8")
@pytest.mark.parametrize("substeps", [1, 3, 8, 13])
@pytest.mark.parametrize(
    ("size", "met", "friction", "least"),
    [
        pytest.param(BRICK, "body", 0.5, 0.5, id="brick"),
        pytest.param(BRICK, "body", 0.0, 0.9, id="smooth"),
        pytest.param(PLATE, "body", 0.5, 0.5, id="plate"),
        pytest.param(ROD, "body", 1.5, 0.5, id="rod"),
        pytest.param(BRICK, "obstacle", 0.5, 0.3, id="obstacle"),
    ],
)
def test_boxes_that_rub_and_rebound_gain_no_energy(size, met, friction, least, substeps, device):
    """Random boxes with restitution 1 hit another, or an obstacle that comes along, at 24 frames a second: none of them
    gains a ten-thousandth at any step, beside the obstacle; on average they keep at least a part."""
    worlds, rng = 24, np.random.default_rng(5)
    alike: dict[str, Any] = {"restitution": 1.0, "friction": friction}
    box = Body(size=size, position=(-0.4, 0, 0), rotation=(20, 30, 10), mass=1.0, velocity=(3, 0, 0), **alike)
    other = Body(size=BRICK, position=(0.4, 0, 0), rotation=(50, 10, 70), mass=3.0, velocity=(-1, 0, 0), **alike)
    along = [(0.0, (0, 0, 0)), (1.0, (-1.0, 0, 0))]
    wall = Obstacle(size=(0.2, 2, 2), position=(0.4, 0, 0), motion=along, **alike)
    vary = {f"body.0.position.{axis}": rng.uniform(-0.12, 0.12, worlds) for axis in (1, 2)}
    vary |= {f"body.0.angular_velocity.{axis}": rng.uniform(-8, 8, worlds) for axis in range(3)}
    setting = {**SPACE, "frames_per_second": 24.0, "substeps": substeps}
    scene = scene_of(box, other, **setting) if met == "body" else scene_of(box, obstacle=[wall], **setting)
    simulator = Simulator(scene, device, world_count=worlds, vary=vary)
    beside = 0.0 if met == "body" else -1.0
    lowest = start = np.array([kinetic(simulator, world, beside) for world in range(worlds)])
    for _ in range(10):
        simulator.step()
        now = np.array([kinetic(simulator, world, beside) for world in range(worlds)])
        assert ((now - lowest) / start).max() < 1e-4
        lowest = np.minimum(lowest, now)
    assert least < np.mean(lowest / start) < 1.0 + 1e-4
    assert np.abs(body_state(simulator, "velocities")[0] - (3, 0, 0)).max() > 0.1  # it has been hit


def substeps_of(**fields: Any) -> int:
    """Return the substeps of a scene that by itself needs one."""
    slack = Balloon(mesh=cube(), position=(0, 9, 0), fixed=list(range(8)))
    return plan_model(Scene(balloon=[slack], **{"frames_per_second": 60.0} | fields)).substeps


@pytest.mark.always
def test_auto_counts_bodies_and_spheres():
    """Substeps follow from things that may touch, by spin, and by speed over size, that of a fall to come as well."""
    crate = Body(position=(0, 1, 0))
    assert substeps_of() == 1
    assert substeps_of(sphere=[Sphere(position=(0, 1, 0))]) == 8
    assert substeps_of(body=[crate]) == 8
    assert substeps_of(body=[crate], frames_per_second=480.0) == 1
    assert substeps_of(body=[crate], substeps=3) == 3
    spinning = crate.model_copy(update={"angular_velocity": (60.0, 0.0, 0.0)})
    assert substeps_of(body=[spinning]) == 10  # a tenth of a radian each
    die = Body(size=(0.02, 0.02, 0.02), position=(0, 1, 0))
    reach = 0.01 * 3**0.5
    assert substeps_of(body=[die], ground=Ground()) == np.ceil((2 * 9.81 * 1.0) ** 0.5 / (0.25 * reach) / 60.0)
    above = die.model_copy(update={"position": (0, 101, 0)})
    assert substeps_of(body=[above], ground=Ground(height=100.0)) == substeps_of(body=[die], ground=Ground())
    thrown = die.model_copy(update={"velocity": (0.0, 0.0, 3.0)})
    assert substeps_of(body=[thrown], gravity=0.0) == np.ceil(3.0 / (0.25 * reach) / 60.0)
    shot = die.model_copy(update={"velocity": (0.0, 0.0, 900.0)})
    assert substeps_of(body=[shot], gravity=0.0) == 167  # no step is shorter than a tenth of a millisecond


@pytest.mark.always("cpu-ground")
@pytest.mark.parametrize("floor", ["ground", "obstacle"])
def test_a_box_that_falls_comes_to_rest_on_its_side(floor, device):
    box = Body(size=(0.4, 0.2, 0.3), position=(0, 0.5, 0), rotation=(20, 30, 40), restitution=0.2)
    below = (
        {"ground": Ground()} if floor == "ground" else {"obstacle": [Obstacle(size=(9, 1, 9), position=(0, -0.5, 0))]}
    )
    simulator = stepped(started(device, box, gravity=9.8, **below), 300)
    height = body_state(simulator, "positions")[0, 1]
    assert min(abs(height - half) for half in (0.1, 0.15, 0.2)) < 2e-3
    assert np.abs(body_state(simulator, "velocities")).max() < 0.01
    assert kinetic(simulator) < 1e-4


MOST = np.array([1.0e-3, 0.5, 1.0e-4])
"""[m] and [degrees]: motion that nobody sees. They stay to some micrometers; `kernels.laws.rigid` leaves overlaps of a
hundred-thousandth of their size. And of the energy, by where their velocities stop to agree"""


def watched(device: str, *bodies: Body, seconds: float = 10.0, **fields: Any) -> tuple[Simulator, NDArray[np.float64]]:
    """Return a simulator of bodies, and how far they have come [m], turned [degrees] and gained energy over that at the
    start, at most."""
    setting: dict[str, Any] = {"ground": Ground(), "gravity": 9.81, "substeps": "auto", "frames_per_second": 60.0}
    simulator, start = (started(device, *bodies, **setting | fields) for _ in range(2))
    (most,) = most_in(simulator, round(seconds * 60.0), body_energy)
    return simulator, np.array([*moved(simulator, start), most / body_energy(start) - 1.0])


def box(x: float, y: float, size: tuple[float, float, float] = (0.3, 0.2, 0.3), **fields: Any) -> Body:
    return Body(size=size, position=(x, y, 0.0), **fields)


def stack(*masses: float) -> list[Body]:
    """Return boxes of those masses on each other, the first at the bottom."""
    return [box(0.0, 0.1 + 0.2 * number, mass=mass) for number, mass in enumerate(masses)]


@pytest.mark.parametrize("substeps", ["auto", 13])
@pytest.mark.parametrize("masses", [(1, 10), (1, 100), (1, 1000), (1, 1, 1, 1, 100), (10, 5, 2, 1, 0.5)])
def test_what_is_heavy_stands_on_what_is_light(masses: tuple[float, ...], substeps: int | str, device: str):
    assert (watched(device, *stack(*masses), seconds=3.0, substeps=substeps)[1] < MOST).all()


STILL = np.array([5.0e-6, 1.0e-3])
"""[m] and [degrees]: rounding of places at the largest step"""


@pytest.mark.always("cpu-auto", "cpu-one")
@pytest.mark.parametrize(
    ("masses", "substeps", "degrees", "seconds"),
    [
        pytest.param((1, 1000), "auto", 0.0, 4.0, id="auto"),
        pytest.param((1, 1000), 1, 0.0, 4.0, id="one"),
        pytest.param((1, 1000), 3, 14.0, 4.0, id="slope"),
        pytest.param((1, 10_000), "auto", 0.0, 4.0, id="ten-thousand"),
        pytest.param((1000, 1, 1000), "auto", 0.0, 4.0, id="between"),
        pytest.param((1, 1000, 1, 1000), 3, 0.0, 4.0, id="four"),
        pytest.param((1, 1000), 3, 0.0, 600.0, id="ten-minutes"),
    ],
)
def test_a_disturbance_of_what_is_heavy_on_what_is_light_does_not_grow(
    masses: tuple[float, ...], substeps: int | str, degrees: float, seconds: float, device: str
):
    """Cubes that begin a micrometer out of line are in place for good after a second.

    They grew tenfold in 0.4 s while they were moved out of the ground in too few sweeps, and fell back aslant.
    """
    slope = Rotation.from_euler("z", degrees, degrees=True)
    slab = Obstacle(shape="plane", rotation=(0, 0, degrees), friction=0.5, restitution=0.0)
    floor = {"obstacle": [slab]} if degrees else {"ground": Ground(friction=0.5, restitution=0.0)}
    cubes = [
        Body(size=(0.2, 0.2, 0.2), position=tuple(place), rotation=(0, 0, degrees), mass=mass)
        for mass, place in zip(
            masses,
            slope.apply([(1e-6 * number, 0.1 + 0.2 * number, 0.0) for number in range(len(masses))]),
            strict=True,
        )
    ]
    begun, later = (
        started(device, *cubes, gravity=9.81, substeps=substeps, frames_per_second=60.0, **floor) for _ in range(2)
    )
    assert (np.array(moved(stepped(later, round(60.0 * seconds)), stepped(begun, 60))) < STILL).all()


@pytest.mark.always
def test_impulses_of_what_has_left_are_forgotten(device: str):
    """The list of touches, which -1 ends, is as long once a cube has been thrown off another one as if it had never
    lain there."""
    floor = Ground(friction=0.5, restitution=0.0)
    lies, ends = Body(size=(0.2, 0.2, 0.2), position=(0.0, 0.1, 0.0), mass=1), []
    for height in (0.3, 9.0):
        thrown = Body(size=(0.2, 0.2, 0.2), position=(0.0, height, 0.0), mass=1, velocity=(0.0, 3.0, 0.0))
        simulator = started(device, lies, thrown, gravity=9.81, frames_per_second=60.0, ground=floor)
        ends.append(list(stepped(simulator, 3).state.body_touches.numpy()[0]).index(-1))
    assert ends[0] == ends[1] > 0


LYING = {"radius": 0.1, "length": 0.5, "rotation": (90, 0, 0), "friction": 0.6}
PLANK = [box(0.0, 0.35, (2.0, 0.1, 0.3)), box(0.0, 0.45, (0.2, 0.1, 0.2), mass=5.0)]
STANDING: dict[str, list[Body]] = {
    **{f"stack of {count}": stack(*[1.0] * count) for count in (1, 5, 8)},
    "thin pole": [box(0.0, 0.5, (0.02, 1.0, 0.02))],
    "wall": [box(0.3 * (i - 0.5 * row), 0.5 - 0.2 * row) for row in range(3) for i in range(row + 1)],
    "pipes": [
        Body(position=(0.2 * (i - 0.5 * row), 0.1 + (2 - row) * 0.1 * 3**0.5, 0.0), **LYING)
        for row in range(3)
        for i in range(row + 1)
    ],
    "meshes": [Body(mesh=cube(), scale=0.3, position=(0.0, 0.15 + 0.3 * number, 0.0)) for number in range(4)],
    "sizes": [box(0.0, 0.2, (0.5, 0.4, 0.4)), box(0.03, 0.45, (0.2, 0.1, 0.25)), box(0.0, 0.65, (0.4, 0.3, 0.3))],
    "shelf": [*(box(x, 0.15, (0.2, 0.3, 0.4)) for x in (-0.8, 0.8)), *PLANK],
    "on thin supports": PLANK,
}


@pytest.mark.parametrize("name", STANDING)
def test_what_stands_stays(name: str, device: str):
    """A stack of five stands for a minute. Edges of supports carry a plank whose own contact points are half a meter
    apart. A mesh is put where its origin is."""
    supports = (-0.8, 0.8) if name == "on thin supports" else ()
    below = [Obstacle(size=(0.1, 0.3, 0.1), position=(x, 0.15, 0)) for x in supports]
    seconds = {"stack of 5": 60.0}.get(name, 10.0 if name.startswith("stack") else 5.0)
    most = MOST + [0.15 if name == "meshes" else 0.0, 0.0, 0.0]
    assert (watched(device, *STANDING[name], seconds=seconds, obstacle=below)[1] < most).all()


@pytest.mark.parametrize("degrees", [20.0, 25.0, 35.0])
def test_two_on_a_slope_stay_or_slide_together(degrees, device):
    """Friction of 0.5 holds two boxes below 26.6 degrees for 20 s; above, they slide with g (sin - friction cos), by
    0.4 m in a second or so."""
    slope = np.radians(degrees)
    out, along = np.array([-np.sin(slope), np.cos(slope), 0.0]), np.array([np.cos(slope), np.sin(slope), 0.0])
    ramp = Obstacle(shape="plane", rotation=(0, 0, degrees), friction=0.5, restitution=0.0)
    boxes = [
        Body(size=(0.4, 0.2, 0.4), position=tuple(height * out), rotation=(0, 0, degrees)) for height in (0.1, 0.3)
    ]
    stays = np.tan(slope) < 0.5
    simulator, found = watched(device, *boxes, seconds=20.0 if stays else 1.0, ground=None, obstacle=[ramp])
    if stays:
        assert (found < MOST).all()
        return
    expected = -0.5 * 9.81 * (np.sin(slope) - 0.5 * np.cos(slope))
    # a step adds g h T / 2
    np.testing.assert_allclose(body_state(simulator, "positions") @ along, expected, rtol=0.01)


@pytest.mark.always
def test_an_overlap_is_shared_by_mass(device):
    """A millimeter of overlap vanishes within some steps, without speed; the common center of mass stays."""
    masses = np.array([1.0, 3.0])
    bodies = [Body(size=(0.3, 0.2, 0.3), position=(0, y, 0), mass=m) for y, m in zip((0.1, 0.299), masses, strict=True)]
    simulator = started(device, *bodies, **SPACE)
    start = body_state(simulator, "positions")
    ways = (body_state(stepped(simulator, 10), "positions") - start)[:, 1]
    np.testing.assert_allclose(ways, [-0.75e-3, 0.25e-3], atol=3e-6)  # but for the overlap left over, see above
    np.testing.assert_array_equal(body_state(simulator, "velocities"), 0.0)
    np.testing.assert_array_equal(body_state(simulator, "momenta"), 0.0)


MASSES = [0.05, 0.4, 2.0]
BATCH = Scene(
    balloon=[Balloon(mesh=cube(), position=(0.0, 0.0, 0.0))],
    body=[
        Body(name="brick", size=(1.5, 0.3, 1.4), position=(0.4, 1.45, 0.5), velocity=(0.0, -3.0, 0.0)),
        Body(shape="capsule", radius=0.1, length=0.3, position=(-2.0, 1.0, 0.0), rotation=(0.0, 0.0, 40.0)),
    ],
    ground=Ground(height=-1.5),
    frames=8,
)


def test_table_and_stage_of_a_batch_say_where_bodies_are(tmp_path: Path):
    run_batch(BATCH, tmp_path, 3, {"body.0.mass": MASSES}, export=[0, 2], device="cpu")
    stage = Usd.Stage.Open(str(tmp_path / "worlds.usdc"))
    with np.load(tmp_path / "table.npz") as table:
        heights = {n: table[f"body_{n}_height"].reshape(9, 3) for n in (0, 1)}
        assert list(table)[-3:] == ["body_0_height", "body_1_height", "health"]
    for world, mass in enumerate(MASSES):
        bodies = [BATCH.body[0].model_copy(update={"mass": mass}), BATCH.body[1]]
        simulator = Simulator(BATCH.model_copy(update={"body": bodies}), "cpu")
        for frame in simulator.run():
            for number, name in enumerate(("brick", "capsule")):
                assert heights[number][frame.number, world] == frame.body_poses[number, 1]
                prim = UsdGeom.Xformable(stage.GetPrimAtPath(f"/World/World_{world}/{name}"))
                assert bool(prim) == (world != 1)
                if prim:
                    place, turn = (op.Get(frame.number) for op in prim.GetOrderedXformOps()[:2])
                    pose = [*place, *turn.GetImaginary(), turn.GetReal()]
                    np.testing.assert_array_equal(np.float32(pose), frame.body_poses[number])
    assert np.ptp(heights[0][-1]) > 1e-3  # the balloon brakes them differently


FULL = 150
"""frame in which the pillow has its pressure"""


def test_turtle_pillow_lifts_the_turtle_level():
    """The turtle rests on the ground through the flat pillow, and then a tenth of a meter higher. It tips by less than
    15 degrees, by 7 or 13 as rounding decides, see docs/LIMITS.md; no particle is in it by more than a hundredth of
    its height."""
    model, frames = played("turtle_pillow")
    body = model.bodies[0]
    assert body.solid.mesh
    distance = MeshDistance(body.solid.mesh.points, body.solid.triangles, thickness=0.0)
    height = float(np.ptp(body.solid.mesh.points[:, 1]))
    for frame in frames[::10]:
        turn = Rotation.from_quat(frame.body_poses[0, 3:])
        seen = turn.inv().apply(frame.points[0].astype(np.float64) - frame.body_poses[0, :3])
        assert distance(seen).min() > -0.01 * height
        assert turn.apply((0.0, 1.0, 0.0))[1] > np.cos(np.radians(15.0))
    heights = np.array([frame.body_poses[0, 1] for frame in frames])
    lowest = heights[: FULL // 3].min()
    assert lowest < 0.4 * height + 0.01
    assert heights[-60:].min() > lowest + 0.07
    assert np.ptp(heights[-30:]) < 0.02


MESHES = {
    "ball": quad_sphere(6), "box": cube(), "prism": prism(7), "torus": torus(12, 7),
    "two": joined(quad_sphere(3), prism(5)),
}  # fmt: skip


@pytest.mark.parametrize("mesh", MESHES.values(), ids=MESHES)
def test_they_are_those_of_trimesh(mesh, device):
    placed = place_mesh(mesh, "Y", 0.3, (20.0, 40.0, 70.0), (5.0, -8.0, 3.0))
    simulator = Simulator(Scene(balloon=[Balloon(mesh=placed)]), device)
    found = simulator.mass_properties()
    expected = fans(placed)
    assert found.closed.tolist() == [True]
    np.testing.assert_allclose(found.volume[0, 0], expected.volume, rtol=1e-5)
    np.testing.assert_allclose(found.center[0, 0], expected.center_mass, rtol=0, atol=1e-6)  # float32 at 8 m
    expected.apply_translation(-expected.center_mass)  # far from the origin trimesh itself loses digits
    scale = np.abs(expected.moment_inertia).max()
    np.testing.assert_allclose(found.inertia[0, 0], expected.moment_inertia, rtol=0, atol=1e-5 * scale)


def test_a_flat_balloon_has_no_volume_and_no_nan(device):
    simulator = Simulator(Scene(balloon=[Balloon(mesh=cube())]), device)
    flat = cube().points * [1.0, 0.0, 1.0]
    wp.copy(simulator.state.points, wp.array(flat[None], dtype=wp.vec3, device=device))
    found = simulator.mass_properties()
    assert found.volume[0, 0] == 0.0
    assert np.isfinite(found.center).all()
    np.testing.assert_array_equal(found.inertia, 0.0)


COARSE = quad_sphere(3, 0.5)
EDGE = edge_length(COARSE)
AT_REST = {"damping": 0.0, "inflation": Inflation(pressure=0.0)}


class Meeting(NamedTuple):
    """Scene of things that meet, and the largest changes of its invariants."""

    scene: Scene
    frames: int
    rounding: float | tuple[float, float]
    """Of momentum [kg m/s] and angular momentum [kg m^2/s] in the end: substeps round to either side, so that it grows
    as the root of their number"""
    pushed: float
    """Change of the momentum of a thing [kg m/s], at least"""
    gain: float = 1e-3
    """Part of the energy: explicit steps swing by h omega / 2 of that in the fastest springs"""
    left: tuple[float, float] = (0.0, 1.001)
    """Part of the energy in the end"""
    falls: bool = False
    """Whether energy that is lost does not come back from springs, either"""
    spun: float = 0.0
    """Spin of a sphere in the end [rad/s], at least"""


def at_a_ball(sphere: Sphere, ball: Balloon | None = None, **fields: object) -> Scene:
    """Return a sphere that flies at a balloon of 386 particles without a pressure, in space."""
    fine = Balloon(mesh=quad_sphere(8, 0.5), mass=0.3, **AT_REST)
    setting = SPACE | {"contact": "impulse", "substeps": 60}
    return Scene(balloon=[ball or fine], sphere=[sphere], **setting | fields)


def rubbing(at: tuple[float, float, float], radius: float, mass: float, friction: float) -> Meeting:
    """Return a sphere that a balloon turns."""
    sphere = Sphere(position=at, radius=radius, mass=mass, velocity=(-2.0, 1.0, 0.4), friction=friction)
    rounding = 0.35 * 2.4 * EPSILON * np.sqrt(15 * 60) * 4.0
    return Meeting(at_a_ball(sphere), 15, rounding, 0.1 * mass, spun=0.5)


def on_faces(speed: float) -> Meeting:
    """Return a sphere much smaller than a face. Rounding comes once more at each of some hundred contacts."""
    sphere = Sphere(position=(0.7, 0.12, 0.05), radius=0.02, mass=0.05, velocity=(-speed, 0.0, 0.2 * speed))
    rounding = 0.35 * speed * EPSILON * np.sqrt(60 * 60) * 4.0
    return Meeting(at_a_ball(sphere, touch=Touch()), 60, rounding, 0.02 * speed)


def on_a_flat_face(friction: float) -> Meeting:
    """Return a sphere larger than the faces, at the middle of one of them."""
    place, moves = (0.56 + 2.0 * EDGE, 0.16, 0.15), {"velocity": (-2.0, 0.0, 0.5), "mass": 0.2}
    sphere = Sphere(position=place, radius=2.0 * EDGE, friction=friction, **moves)
    scene = at_a_ball(sphere, Balloon(mesh=COARSE, mass=0.3, **AT_REST), faces=True)
    return Meeting(scene, 40, (2e-6, 6e-5), 0.1, left=(0.0, 0.95), falls=True)


def on_a_wall(speed: float) -> Meeting:
    """Return a sphere that a free wall throws back; in a step of the fast one's it goes ten times its thickness."""
    wall = Body(size=(0.05, 1.0, 1.0), mass=3.0, restitution=1.0)
    moves = {"mass": 0.5, "velocity": (speed, 0, 0), "restitution": 1.0, "friction": 1e-9}
    scene = scene_of(wall, sphere=[Sphere(position=(-0.5, 0.2, 0.1), radius=0.05, **moves)], **SPACE)
    return Meeting(scene, 40, 400 * EPSILON * speed, 0.5 * speed, gain=0.02, left=(0.98, 1.02))


def on_the_end_of_a_box() -> Meeting:
    box = Body(shape="box", size=(0.4, 0.1, 0.3), mass=0.5, friction=0.8)
    ball = Sphere(position=(0.12, 0.3, 0.02), radius=0.1, mass=0.3, velocity=(-1.0, -2.0, 0.3), friction=0.8)
    scene = scene_of(box, sphere=[ball], **SPACE, frames_per_second=60.0, substeps=60)
    return Meeting(scene, 12, 2e-6, 0.1, left=(0.0, 0.99), spun=1.0)


def two_boxes() -> Meeting:
    """Return a box that hits another off its center, with friction, so that both turn away."""
    boxes = [
        Body(size=(0.4, 0.3, 0.2), position=(-0.6, 0.1, 0.02), velocity=(3.0, 0, 0), mass=1.0),
        Body(size=(0.2, 0.5, 0.3), position=(0, 0, 0), mass=2.0, angular_velocity=(1.0, 0, 2.0)),
    ]
    return Meeting(scene_of(*boxes, **SPACE), 60, 600 * EPSILON * 3.0, 0.6, gain=1e-4)


def body_at_a_ball(mass: float) -> Meeting:
    """Return a turning body that hits a balloon at rest off its center."""
    ball = Balloon(mesh=quad_sphere(6, 0.5), mass=0.5, **AT_REST)
    moves = {"position": (0.15, 0.9, 0.05), "velocity": (0, -2.0, 0.2), "angular_velocity": (1, 2, -1)}
    setting = SPACE | {"balloon": [ball], "substeps": 40, "faces": False, "frames_per_second": 60.0}
    rounding = 4.0 * EPSILON * np.sqrt(40 * 30) * 2.0 * (mass + 0.5)
    return Meeting(scene_of(Body(size=(0.5, 0.3, 0.4), mass=mass, **moves), **setting), 30, rounding, 0.02 * mass)


MEETINGS = {
    "balloons": Meeting(collision(), 60, EPSILON * np.sqrt(48 * 60) * 0.6 * 4.0, 0.3, left=(0.5, 0.99)),
    **{f"large sphere, friction {mu}": rubbing((0.75, 0.2, 0.05), 0.15, 0.2, mu) for mu in (0.3, 5.0)},
    **{f"small sphere, friction {mu}": rubbing((0.6, 0.2, 0.05), 0.02, 0.05, mu) for mu in (0.3, 5.0)},
    **{f"faces at {speed} m per s": on_faces(speed) for speed in (1.0, 20.0)},
    **{f"flat face, friction {mu}": on_a_flat_face(mu) for mu in (0.0, 0.6)},
    **{f"wall at {speed} m per s": on_a_wall(speed) for speed in (2.0, 500.0)},
    "end of a box": on_the_end_of_a_box(),
    "two boxes": two_boxes(),
    **{f"body of {mass} kg": body_at_a_ball(mass) for mass in (0.02, 20.0)},
}
BY_DEFAULT = ("wall at 2.0 m per s", "wall at 500.0 m per s", "end of a box", "two boxes")


def momenta(simulator: Simulator) -> NDArray[np.float64]:
    """Return the momentum of each balloon, sphere and body [kg m/s], shape (things, 3)."""
    of_particles = masses(simulator)[:, None] * motion(simulator)[1]
    of_balloons = np.add.reduceat(of_particles, simulator.model.particle_offsets[:-1])
    of_bodies = body_masses(simulator)[:, None] * body_state(simulator, "velocities")
    return np.concatenate([of_balloons, sphere_momenta(simulator), of_bodies])


@pytest.mark.always(*(f"{device}-{name}" for device in ("cpu", "cuda:0") for name in BY_DEFAULT))
@pytest.mark.parametrize("name", MEETINGS)
def test_momentum_and_angular_momentum_stay_and_no_energy_is_gained(name: str, device: str):
    scene, frames, rounding, pushed, gain, left, falls, spun = MEETINGS[name]
    simulator = Simulator(scene, device)
    start, before, energies, most = whole(simulator), momenta(simulator), [1.0], 0.0
    for frame in range(1, frames + 1):
        simulator.step_unread()
        *now, energy = whole(simulator)
        allowed = np.broadcast_to(rounding, 2) * np.sqrt(frame / frames)
        for found, expected, atol in zip(now, start[:2], allowed, strict=True):
            np.testing.assert_allclose(found, expected, atol=atol)
        energies.append(energy / start[2])
        most = max(most, float(np.abs(momenta(simulator) - before).max()))
    assert most > pushed
    bounds = np.minimum.accumulate(energies)[:-1] if falls else np.ones(frames)
    assert (energies[1:] < (1.0 + gain) * bounds).all()
    assert left[0] < energies[-1] < left[1]
    assert np.abs(sphere_spins(simulator)).max(initial=0.0) >= spun
