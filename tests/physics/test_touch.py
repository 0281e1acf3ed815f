"""Contact of balloons with each other and with themselves: conservation, overlaps, and how skins rub."""

import re
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import small_batch
from conserved import (
    RADIUS,
    SLACK,
    VACUUM,
    after_each,
    ball,
    centers,
    collision,
    deepest,
    energy,
    fast,
    masses,
    most_in,
    motion,
    ramp,
    speed,
    square,
    touching,
)
from meshes import cube, mesh_of, moebius, prism, quad_sphere, torus
from trajectories import after_frames, stepped

from balloon_warp import InputError, run_batch
from balloon_warp.benchmarks.standing import stack
from balloon_warp.errors import BlowUpError
from balloon_warp.mesh import PolygonMesh
from balloon_warp.scene import Atmosphere, Balloon, Ground, Inflation, Scene, Stiffness, Touch, load_scene
from balloon_warp.schedules import touch_table as contact_lists
from balloon_warp.simulator import Simulator
from balloon_warp.studio.animate import animate


@pytest.mark.parametrize(
    ("count", "fineness", "softness", "frames"),
    [(1, 12, 0.1, 80), (2, 8, 1.0, 120), (6, 4, 0.1, 110)],
    ids=["one", "two", "six"],
)
def test_what_crumples_is_no_faster_than_it_falls(count: int, fineness: int, softness: float, frames: int, device: str):
    """Speeds of slack balls that fall on each other stay below that of the fall, but for a fifth, by which a skin may
    whip. Lost energy does not return, but for the swing of explicit steps: a two-thousandth. If contacts in a crowd did
    not share the limit of a step, six would gain more while they settle."""
    soft = Stiffness(structural=40.0 * softness, shear=20.0 * softness, flexion=2.0 * softness)
    slack = {"mesh": quad_sphere(fineness, RADIUS), "stiffness": soft, "damping": 0.3, "inflation": SLACK}
    balls = [ball(0.1 * n, 0.55 + 1.05 * n, 0.05 * n, **slack) for n in range(count)]
    air = Atmosphere(density=0.0)
    scene = Scene(balloon=balls, ground=Ground(), touch=Touch(itself=True), atmosphere=air)
    simulator = Simulator(scene, device)
    fall = np.sqrt(2.0 * 9.81 * motion(simulator)[0][:, 1].max())

    def of_all(simulator: Simulator) -> float:
        return energy(simulator) + float(9.81 * masses(simulator) @ motion(simulator)[0][:, 1])

    first, told = of_all(simulator), after_each(simulator, frames, lambda each: (of_all(each), speed(each)))
    energies = np.array([first, *(each for each, _ in told)])
    assert touching(simulator) > 20
    assert max(fastest for _, fastest in told) < 1.2 * fall
    assert np.max(energies - np.minimum.accumulate(energies)) < 0.0005 * first


@pytest.mark.parametrize("touches", [True, False])
def test_fast_balloons_do_not_come_through_each_other(touches: bool, device: str):
    """No contact is ignored, though many triangles are near a particle until the next search."""
    simulator = Simulator(fast() if touches else fast().model_copy(update={"touch": False}), device)
    gaps = after_each(simulator, 30, lambda each: np.diff(centers(each)[:, 0])[0])
    assert touching(simulator) == 0
    assert (min(gaps) > 0.0) == (gaps[-1] > 0.0) == touches
    assert not simulator.warnings


@pytest.mark.parametrize(
    ("apart", "inflation"), [((0.7, 0.105), SLACK), ((0.8, 0.0), Inflation(pressure=5.0))], ids=["slack", "soft"]
)
def test_what_overlaps_at_the_start_comes_apart_gently(apart: tuple[float, float], inflation: Inflation, device: str):
    """An initial overlap is resolved gently: ten times the overlap begins to push each second, on either side, so that
    no particle gets faster than twice ten times the deepest overlap, but for the speed by a pressure."""
    balls = [ball(0.0, 0.0, 0.0, inflation=inflation), ball(*apart, 0.0, inflation=inflation)]
    simulator = Simulator(Scene(balloon=balls, touch=Touch(), **VACUUM), device)
    deep = deepest(simulator)
    assert deep > 0.15
    (fastest,) = most_in(simulator, 60, speed)
    assert deepest(simulator) == 0.0
    assert inflation is not SLACK or fastest < 20.0 * deep


def test_what_is_pressed_in_deep_comes_out_where_it_came_in(device: str):
    """Two balls with a soft skin sink deeper than the search for neighbors reaches, and bounce back."""
    filled = Inflation(kind="pressure", pressure=20.0)
    balls = [ball(x, 0.0, 0.0, velocity=(-x / 0.3, 0.0, 0.0), inflation=filled) for x in (-0.6, 0.6)]
    simulator = Simulator(Scene(balloon=balls, touch=Touch(stiffness=1.0), **VACUUM), device)
    assert most_in(simulator, 60, deepest) > [0.2 * RADIUS]
    first, second = centers(simulator)[:, 0]
    assert second - first > 1.0 + 2.0 * RADIUS
    assert touching(simulator) == 0


def test_coincident_balloons_stay_finite(device: str):
    """Coincident balloons stay finite, be it particle by particle or one in the very center of another."""
    mesh = quad_sphere(4, RADIUS)
    coarse, grain = ball(0, 0, 0, mesh=mesh), Balloon(mesh=mesh, scale=1e-3, inflation=SLACK)
    scene = Scene(balloon=[coarse, coarse, grain], touch=Touch(itself=True), **VACUUM)
    state = after_frames(scene, "auto", device, 10).state
    assert np.isfinite(state.points.numpy()).all()
    assert np.isfinite(state.holds.numpy()).all()


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_an_open_surface_stops_what_comes_from_either_side(side: float, device: str):
    sheet = square(8, 2.0)
    border = np.flatnonzero(np.abs(sheet.points).max(axis=1) == 1.0).tolist()
    coming = ball(0.0, 0.0, 0.6 * side, velocity=(0.0, 0.0, -2.0 * side), inflation=Inflation(pressure=20.0))
    held = Balloon(mesh=sheet, fixed=border, mass=0.2, inflation=SLACK)
    simulator = Simulator(Scene(balloon=[held, coming], touch=Touch(), **VACUUM), device)
    assert most_in(simulator, 60, touching) > [20]
    assert side * centers(simulator)[1, 2] > 0.6


def test_a_chain_lies_on_a_ball(device: str):
    """A chain lies on a ball: its particles touch, and nothing touches its edges, which have no surface."""
    chain = mesh_of([(x, 0.0, 0.0) for x in np.linspace(-0.2, 0.2, 9)], [[n, n + 1] for n in range(8)])
    falling = Balloon(mesh=chain, position=(0.0, 0.7, 0.0), velocity=(0.0, -2.0, 0.0), mass=0.02, inflation=SLACK)
    scene = Scene(balloon=[falling, ball(0.0, 0.0, 0.0)], touch=Touch(itself=True), **VACUUM)
    simulator = after_frames(scene, "auto", device, 20)
    points = motion(simulator)[0][:9]
    assert np.linalg.norm(points - centers(simulator)[1], axis=1).min() > 0.95 * RADIUS


def needles() -> PolygonMesh:
    """Return a sheet of which some triangles have their corners on a line, two at one place, or all of them."""
    points = [(0, 0, 0), (1, 0, 0), (1, 0, 1), (0, 0, 1), (0.5, 0, 0), (0, 0, 0), (0, 0, 0)]
    return mesh_of(points, [[0, 1, 2], [0, 2, 3], [0, 4, 1], [0, 5, 1], [0, 5, 6]])


@pytest.mark.always("cpu-needles")
@pytest.mark.parametrize(
    "mesh", [moebius(12), prism(7), torus(12, 6), needles()], ids=["moebius", "prism", "torus", "needles"]
)
def test_what_surfaces_there_are_stay_finite_and_slow(mesh: PolygonMesh, device: str):
    """Two of each open or odd surface thrown at each other stay finite, and nothing gets faster than both were."""
    balls = [
        Balloon(mesh=mesh, damping=1e-30, inflation=SLACK),  # that does nothing, with the kernels of others
        Balloon(mesh=mesh, position=(0.3, 0.9, 0.1), velocity=(0.0, -2.0, 0.0), damping=0.0, inflation=SLACK),
    ]
    simulator = Simulator(Scene(balloon=balls, touch=Touch(itself=True), **VACUUM), device)
    assert most_in(simulator, 40, touching) > [0]
    assert np.abs(motion(simulator)[1]).max() < 4.0


@pytest.mark.parametrize("fine_above", [True, False])
def test_a_coarse_and_a_fine_ball_touch(fine_above: bool, device: str):
    """Balls of 98 and 1,538 particles bounce: the fine one rests on large triangles, and pushes their few corners.
    Quads are not flat: a fan is not two triangles, which are off by their height over the diagonal."""
    meshes = [quad_sphere(4, RADIUS), quad_sphere(16, RADIUS)]
    quads = meshes[0].points[meshes[0].face_vertex_indices.reshape(-1, 4)]
    lower, upper = meshes if fine_above else meshes[::-1]
    firm = {"inflation": Inflation(pressure=15.0), "damping": 0.3}
    balls = [
        ball(0.0, 0.0, 0.0, mesh=lower, **firm),
        ball(0.0, 1.2, 0.0, mesh=upper, velocity=(0.0, -1.0, 0.0), **firm),
    ]
    simulator = Simulator(Scene(balloon=balls, touch=Touch(), **VACUUM), device)
    touched, deep = most_in(simulator, 60, touching, deepest)
    assert touched > 10
    height = np.linalg.norm(quads[:, [0, 2]].mean(axis=1) - quads[:, [1, 3]].mean(axis=1), axis=1).max()
    assert deep < 0.02 * RADIUS + height


def test_a_stack_of_five_stands_still(device: str):
    """Boxes of soft rubber, dropped on each other a little askew, stand two seconds later; none has slipped off, and
    the highest moves by an invisible thousandth of its size a second."""
    simulator = Simulator(stack(), device)
    start, before, after = centers(simulator), *(centers(stepped(simulator, frames)) for frames in (150, 60))
    assert np.abs(after - start).max() < 0.05  # as they were put, but for the weight
    assert np.linalg.norm(after - before, axis=1).max() < 1e-3
    assert speed(simulator) < 0.05
    assert (np.diff(after[:, 1]) > 0.98).all()


@pytest.mark.parametrize(
    ("degrees", "friction", "own", "between"),
    [
        (35.0, 0.5, (None, None), 0.5),
        (20.0, 0.0, (None, None), 0.0),
        (30.0, 0.4, (0.8, 0.05), 0.2),
        (30.0, 0.4, (None, 0.1), 0.2),
        (30.0, 0.4, (0.0, None), 0.0),
    ],
)
def test_above_it_a_block_slides_as_coulomb_says(
    degrees: float, friction: float, own: tuple[float | None, ...], between: float, device: str
):
    """A block slides at g (sin a - friction cos a), once it has come down on the plane. Friction is the geometric mean
    of the plane's and the block's; `touch.friction` stands in for those that have none."""
    scene = ramp(degrees, friction)
    owns = [each.model_copy(update={"friction": its}) for each, its in zip(scene.balloon, own, strict=True)]
    simulator = after_frames(scene.model_copy(update={"balloon": owns}), "auto", device, 20)

    block = slice(simulator.model.particle_offsets[1], None)
    before, later = ([values[block].mean(axis=0) for values in motion(stepped(simulator, n))] for n in (0, 30))
    angle = np.radians(degrees)
    expected = 9.81 * (np.sin(angle) - between * np.cos(angle))
    assert (np.linalg.norm(later[1]) - np.linalg.norm(before[1])) / 0.5 == pytest.approx(expected, rel=0.03)
    moved = later[0] - before[0]
    assert moved @ (0.0, np.cos(angle), np.sin(angle)) == pytest.approx(0.0, abs=0.005)  # along the plane
    assert moved[2] > 0.0  # down


def test_what_has_no_place_in_a_list_is_told(device: str, tmp_path: Any, monkeypatch: pytest.MonkeyPatch):
    """A want of memory for longer lists is told: a command and Python tell it alike; a batch counts it in all worlds:
    each has as many as alone."""

    def count(sentence: str) -> int:
        (times,) = re.findall(r"^touch: contacts were too crowded ([0-9,]+) times and some were ignored", sentence)
        return int(times.replace(",", ""))

    monkeypatch.setattr(contact_lists, "TRIANGLES", 8)
    monkeypatch.setattr(contact_lists, "usable_memory", lambda device: 0)
    scene, told, alone = load_scene(fast(), {"frames": 4}), [], []
    animate(scene, tmp_path / "one.usdc", device=device, schedule="gather", on_warning=alone.append)
    run_batch(scene, tmp_path, 16, schedule="gather", on_warning=told.append, device=device)
    ((sentence,), (of_all,)) = alone, told
    assert count(of_all) == 16 * count(sentence)
    assert after_frames(scene, "gather", device, 4).warnings == alone


@pytest.mark.parametrize(
    ("overrides", "said"),
    [
        ({"touch": "no"}, "touch: must be a table or false (got 'no')"),
        ({"touch.thickness": -1.0}, "touch.thickness: must be greater than or equal to 0 (got -1.0)"),
        (
            {"touch.balloons": False, "touch.itself": False, "touch.spheres": False},
            "touch.balloons: expected true for balloons, itself or spheres (got none); touch = false turns all "
            "contact off",
        ),
        (
            {"solver": "projective"},
            'solver: "projective" does not support balloons that touch; expected another solver',
        ),
        ({"touch.stiffness": 1e5, "substeps": 12}, "substeps: 12 are too few"),
    ],
)
def test_mistakes_are_named(overrides: dict[str, Any], said: str):
    with pytest.raises(InputError, match=re.escape(said)):
        Simulator(load_scene(collision(), overrides), "cpu")


def test_a_blow_up_names_what_touched(device: str):
    """The report names a touching particle, any of two plates so thin that all of theirs lie on the other."""
    box = cube()
    plate = replace(box, points=box.points * [0.01, 1.0, 1.0])
    boxes = [Balloon(mesh=plate, position=(x, 0.0, 0.0), inflation=SLACK) for x in (0.0, -0.0101)]
    simulator = Simulator(Scene(balloon=boxes, touch=Touch(), **VACUUM), device)
    simulator.step()
    assert touching(simulator) > 0
    simulator.set_parameters({"gravity": [1e12 - 1e9]})
    with pytest.raises(BlowUpError, match="it touched a balloon"):
        simulator.step()


def test_a_world_that_blows_up_leaves_the_others_alone(device: str):
    """A world that blows up leaves the others unchanged: no triangle is near points that are not numbers, where a
    regression read one before the first."""
    scene = small_batch.scene().model_copy(update={"touch": Touch()})
    vary = {"balloon.inflation.k_normal": [0.2, 9e11]}
    simulator = Simulator(scene, device, 2, vary, schedule="gather")
    alone = Simulator(load_scene(scene, {"balloon.inflation.k_normal": 0.2}), device, schedule="gather")
    for _ in range(4):
        simulator.advance()
        alone.advance()
    points = simulator.state.points.numpy()
    assert not np.isfinite(points[1]).all()
    np.testing.assert_array_equal(points[0], alone.state.points.numpy()[0])
