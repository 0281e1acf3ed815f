"""Blow-ups and ends that are bad: their reports, and the check after a frame that finds bad worlds and no others."""

import json
import re
from collections import deque
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import warp as wp
from meshes import at, cube, grid, hook, joined, mesh_of, quad_sphere

from balloon_warp import Atmosphere, BlowUpError, InputError, PolygonMesh, Simulator, animate, run_batch
from balloon_warp.blow_ups import BlowUp
from balloon_warp.kernels.tables import HEALTHY
from balloon_warp.run.report import BadEnding, bad_endings
from balloon_warp.scene import Balloon, Change, Ground, Inflation, Obstacle, Scene, Sphere, Stiffness, String
from balloon_warp.scene.load import override_scene
from balloon_warp.schedules.frames import FARTHEST, MOST_SPAN, HealthCheck

NO_INFLATION = Inflation(k_normal=0.0)
SLACK = Stiffness(structural=0.0, shear=0.0, flexion=0.0)
TOO_MUCH = Inflation(k_normal=9e11)
RISES = Inflation(k_normal=[(0.0, 0.0), (1.0 / 60.0, 0.0), (2.0 / 60.0, 9e11)])
BESIDE = Balloon(mesh=cube(), position=(9.0, 0.0, 0.0), inflation=NO_INFLATION)


def blow_up(simulator: Simulator, frames: int = 100) -> Any:

    with pytest.raises(BlowUpError) as failure:
        deque((simulator.step() for _ in range(frames)), maxlen=0)
    report = failure.value.report
    assert isinstance(report, BlowUp)
    assert str(failure.value) == str(report)
    return report


def on_a_spring(**scene: object) -> Scene:
    """Return particle 1 of a kilogram under particle 0, which is fixed, on a spring of a meter."""
    mesh = mesh_of([(0, 0, 0), (0, -1, 0)], [[0, 1]])
    rubber = Stiffness(structural=1.0, shear=0.0, flexion=0.0)
    balloon = Balloon(mesh=mesh, mass=1.0, damping=0.5, fixed=[0], stiffness=rubber, inflation=NO_INFLATION)
    return Scene(balloon=[balloon], substeps=7, frames_per_second=10.0, **scene)


def stiffened(simulator: Simulator) -> Simulator:
    """Make springs too stiff for the step, after the scene's check."""
    simulator.set_parameters({"structural": [[6e4]]})
    return simulator


def end_of_the_spring(stiffness: float, begin: float, step: float) -> tuple[int, float]:
    """Return the number of substeps until the particle on the spring leaves the bounds, and its distance just before,
    by the paper's step in double precision; from `begin` on the spring has that stiffness instead of 1 N/m."""
    height, before, speed, count = -1.0, -1.0, 0.0, 0
    while abs(height) < MOST_SPAN:
        constant, before = stiffness if count * step > begin - 1e-9 else 1.0, height
        speed = (speed + step * (-9.81 - constant * (height - np.sign(height)))) / (1.0 + 0.5 * step)
        height += step * speed
        count += 1
    return count, abs(before)


@pytest.mark.full
def test_a_spring_too_stiff_for_the_step_is_named_with_the_substep_its_stretch_and_a_step_that_is_not(device):
    """The step amplifies the motion tenfold a substep, so that rounding does not move the last one."""
    simulator = Simulator(on_a_spring(), device)
    for _ in range(3):
        simulator.step()
    report = blow_up(stiffened(simulator))
    step = 0.1 / 7
    count, before = end_of_the_spring(6e4, 0.3, step)
    assert count > 3 * 7 + 4
    assert (report.world, report.frame, report.substep) == (0, 1 + (count - 1) // 7, 1 + (count - 1) % 7)
    assert (report.body, report.other, report.touched) == ("particle 1", None, ())
    assert report.spring.by == "the structural spring to particle 0"
    assert report.spring.stretch == pytest.approx(before, rel=1e-3)  # of a meter at rest; float32, grown over substeps
    assert report.spring.newtons == pytest.approx(6e4 * (before - 1.0), rel=1e-3)
    assert report.step == pytest.approx(step)
    assert report.stable_step == pytest.approx(2.0 / np.sqrt(6e4))  # of a kilogram
    assert "substeps a frame, more damping or softer springs help" in str(report)


@pytest.mark.full
def test_the_stable_step_counts_drag_at_the_speed_of_the_moment(device):
    box = Balloon(mesh=cube(), mass=1.0, damping=0.0, drag_coefficient=0.5, stiffness=SLACK, inflation=NO_INFLATION)
    simulator = Simulator(Scene(balloon=[box], atmosphere=Atmosphere(density=1.2), substeps=4), device)
    simulator.state.velocities.assign(np.tile([1e8, 0.0, 0.0], (1, 8, 1)))
    report = blow_up(simulator)
    assert (report.frame, report.substep) == (1, 1)
    rate = 1.2 * 0.5 * 2.0 * 6.0 * 1e8  # the area counts twice
    assert report.stable_step == pytest.approx(2.0 / rate, rel=1e-5)
    assert "less force, more damping" in str(report)


def test_the_substeps_that_it_asks_for_are_enough(device):
    def shaken() -> Simulator:
        simulator = stiffened(Simulator(Scene(balloon=[BESIDE]), device))
        simulator.state.velocities.assign(np.random.default_rng(0).normal(size=(1, 8, 3)))
        return simulator

    sentence, simulator = str(blow_up(shaken())), shaken()
    enough = int(sentence.rpartition(" substeps a frame")[0].rpartition(" ")[2])
    simulator.go_on_in(replace(simulator.model, substeps=enough))
    for _ in range(50):
        simulator.step()


def test_what_changes_on_the_way_changes_in_the_replay(device):
    """The replay repeats planned changes: gravity stretches the spring at frame 5, and again at 20."""
    pull = [Change(time=0.5, set={"gravity": 20.0}), Change(time=2.0, set={"gravity": 9e9})]
    report = blow_up(Simulator(on_a_spring(change=pull), device))
    step = 0.1 / 7
    falls = np.cumsum(9e9 * step**2 * np.arange(1, 8))  # the spring, of 1 N/m, holds nothing
    assert (report.frame, report.substep) == (21, 1 + int(np.argmax(falls > MOST_SPAN)))
    assert report.body == "particle 1"


RISES_LATER = [(0.0, 0.0), (0.1, 0.0), (0.1 + 1.0 / 60.0, 9e11)]


@pytest.mark.parametrize(
    ("inflation", "frame", "cause"),
    [
        pytest.param({"k_normal": 9e11}, 1, "its k_normal of {0:.3g}, {1:.3g} N in all,", id="push"),
        pytest.param({"k_normal": RISES_LATER}, 7, "its k_normal of {0:.3g}, {1:.3g} N in all,", id="rising push"),
        pytest.param({"pressure": 5e8}, 1, "its pressure of {0:.3g} Pa", id="pressure", marks=pytest.mark.full),
    ],
)
def test_inflation_that_no_step_can_follow_is_the_cause(inflation: dict, frame: int, cause: str, device):
    """An enormous inflation is named as the cause, from the start or from a keyframe on, at its value then; a modest
    one is not, where something else is."""
    [(name, value)] = inflation.items()

    def report_of(value: Any, **fields: Any) -> Any:
        ball = Balloon(mesh=cube(), name="box", inflation=Inflation(**{name: value}), mass=2.0)
        return blow_up(Simulator(Scene(balloon=[BESIDE, ball], frames=120, touch=False, **fields), device))

    report = report_of(value, substeps=4 if name == "k_normal" else 20)
    assert report.frame == frame
    assert re.fullmatch(r"particle [0-7] of box", report.body or "")
    assert report.other.by == "inflation"
    assert report.stable_step > report.step
    assert report.substep is not None
    expected = 9e11 * (report.substep - 1) / 4.0 if value == RISES_LATER else value
    found = getattr(report, name)
    assert found == report.as_json()[name] == pytest.approx(expected, rel=1e-4)
    if name == "k_normal":  # a corner has the share of one of six faces
        assert report.other.newtons == pytest.approx(100.0 * found / 6.0, rel=1e-5)
    assert f"{cause.format(found, 100.0 * found)} alone blows it up within a frame" in str(report)
    assert "substeps" not in str(report)
    other = report_of({"k_normal": 0.2, "pressure": 10.0}[name], substeps=20, gravity=9e11)
    assert (other.k_normal, other.pressure) == (None, None)


@pytest.mark.full
@pytest.mark.parametrize(
    ("obstacles", "touched"),
    [
        ({}, ()),
        ({"ground": Ground(height=1.0)}, ("the ground",)),
        ({"sphere": [Sphere(position=(9.0, 9.0, 9.0)), Sphere(position=(0.5, 0.5, 0.5), radius=2.0)]}, ("sphere 1",)),
    ],
)
def test_what_the_particle_lay_on_is_named(obstacles: dict, touched: tuple, device: str):
    scene = Scene(balloon=[Balloon(mesh=cube(), inflation=TOO_MUCH)], faces=False, **obstacles)
    report = blow_up(Simulator(scene, device))
    assert report.touched == touched
    assert all(f"; it touched {name}; " in str(report) for name in touched)


@pytest.mark.full
def test_a_string_that_pulls_too_hard_is_named(device):
    scene = on_a_spring(string=[String(anchor=(0.0, -4.0, 0.0), particle=1, length=1.0, stiffness=2.0)])
    simulator = Simulator(scene, device)
    simulator.set_parameters({"string_stiffness": [[1e6]]})
    report = blow_up(simulator)
    assert report.other.by == "string 0"
    assert report.other.newtons > 1e5


@pytest.mark.full
def test_a_sphere_that_flies_off_is_named_with_the_particle_that_pushed_it(device):
    place = tuple(cube().points[2] + np.array([0.3, 0.3, 0.3]))
    ball = Sphere(position=place, radius=0.6, mass=1e-12, penalty=1.0)
    inflated = Balloon(mesh=cube(), name="box", inflation=Inflation(k_normal=1.0))
    report = blow_up(Simulator(Scene(balloon=[BESIDE, inflated], sphere=[ball]), device))
    assert report.body == "sphere 0"
    assert report.other.by == "particle 2 of box in contact with it"
    # of 100 k_normal N in all: the corner has the share of one of six faces, which have hardly moved
    assert report.other.newtons == pytest.approx(100.0 / 6.0, rel=0.01)


@pytest.mark.parametrize("schedule", ["scatter", "gather", "octets", "lanes", "block", "auto"], indirect=True)
def test_every_schedule_gives_the_same_report_in_a_batch_and_alone(schedule: str, device: str):
    solver = "projective" if schedule == "auto" else "symplectic_euler"  # the implicit solver has its own schedule
    scene = Scene(balloon=[Balloon(mesh=cube(), inflation=RISES)], solver=solver)
    alone = blow_up(Simulator(scene.model_copy(update={"gravity": 10.0}), device, schedule=schedule))
    batch = Simulator(scene, device, 3, {"gravity": [9.0, 9.5, 10.0]}, schedule=schedule)
    for _ in range(4):
        batch.advance()
    among_others = batch.diagnose(2, 2)
    assert alone.substep is not None
    if device == "cpu":
        assert among_others == replace(alone, world=2)
    else:  # the last frame is simulated again by atomic adds, which round in any order there
        assert (among_others.frame, among_others.substep) == (alone.frame, alone.substep)


def test_a_state_that_somebody_wrote_to_is_reported_without_what_is_not_known(device):
    simulator = Simulator(Scene(balloon=[BESIDE]), device)
    simulator.step()
    velocities = simulator.state.velocities.numpy()
    velocities[0, 5] = np.inf
    simulator.state.velocities.assign(velocities)
    report = blow_up(simulator)
    assert (report.frame, report.substep, report.spring) == (2, None, None)


@pytest.mark.full
def test_nothing_that_is_not_finite_leaves_a_run(device):
    """Overflowing velocities at finite places, which the device does not check, raise the error too: forward Euler
    moves the points by the old velocities, and these overflow in the frame's only step."""
    scene = on_a_spring(frames=3, solver="forward_euler").model_copy(update={"substeps": 1})
    simulator = Simulator(scene, device)
    simulator.set_parameters({"mass": [[1e-3]], "damping": [[0.0]], "structural": [[3e38]]})
    points = simulator.state.points.numpy()
    points[0, 1, 1] = -1.5
    simulator.state.points.assign(points)
    frames = simulator.run()
    assert next(frames).is_finite
    with pytest.raises(BlowUpError, match="frame 1, world 0"):
        next(frames)
    assert simulator.state.first_bad.numpy().tolist() == [HEALTHY]
    assert np.isfinite(simulator.state.points.numpy()).all()
    assert not np.isfinite(simulator.state.velocities.numpy()).all()


BALL = quad_sphere(6)


def endings(points: np.ndarray, mesh: PolygonMesh = BALL, speed: float = 0.0, **fields: Any) -> list[BadEnding]:
    """Return outcome checks of a balloon at these points that moves downward."""
    simulator = Simulator(Scene(**{"balloon": [Balloon(mesh=mesh)], "ground": Ground(), **fields}), "cpu")
    frame = simulator.read_frame()
    velocities = np.full_like(points, -speed) * np.array([0.0, 1.0, 0.0])
    return bad_endings(simulator.model, replace(frame, points=[points], velocities=[velocities]))


def two_balls(apart: float) -> PolygonMesh:
    """Return two components, of which the second is smaller."""
    return joined(BALL, at(quad_sphere(4, 0.3), (apart, 0.0, 0.0)))


def under(pressure: float, **fields: Any) -> dict[str, Any]:
    """Return a scene's field: a balloon under a requested pressure."""
    return {"balloon": [Balloon(mesh=BALL, inflation=Inflation(pressure=pressure), **fields)]}


POINTS, SHEET, SIZE = BALL.points, grid(4, 4), np.ptp(BALL.points, axis=0).max()
TURNED = POINTS[:, [2, 0, 1]]  # about the diagonal
WIDE, LOW = POINTS * np.array([1.2, 0.72, 1.2]), POINTS - np.array([0.0, 6.0 * SIZE, 0.0])
GENTLE = {"balloon": [Balloon(mesh=BALL, inflation=Inflation(stretch=0.1))]}
DOWN = {"speed": 1.0, "ground": None}
APART = {"mesh": two_balls(0.8)}


def tied(**until: float) -> dict[str, Any]:
    return DOWN | {"string": [String(anchor=(0.0, 3.0, 0.0), **until)]}


def above(*place: float, **fields: Any) -> dict[str, Any]:
    """Return the fields of a scene with an obstacle at a place, in sizes of the ball."""
    x, y, z = (SIZE * each for each in place)
    return DOWN | {"obstacle": [Obstacle(position=(x, y, z), **fields)]}


SANK = "collapsed: mesh sank to 72% of its height; less weight, "
CRUMPLED = "collapsed: mesh crumpled to 83% of the volume of its mesh; less weight or more pressure helps"
FOREVER = "falling: mesh falls forever: 6 times its size below the start; a [ground] would stop it"
DRIFTED = "drifted: mesh came apart: a part of its 2 drifted off, up to 3 m from the largest"
ENDINGS: dict[str, tuple[np.ndarray, dict[str, Any], str]] = {
    "grown, turned and moved": (1.3 * TURNED + np.array([50.0, 70.0, 0.0]), {}, ""),
    "two that turned": (1.3 * two_balls(0.6).points[:, [2, 0, 1]], {"mesh": two_balls(0.6)}, ""),
    "grown past recognition": (1.5 * POINTS, {}, "swollen: mesh swelled to 3.4 times its volume; less pressure helps"),
    "grown to 3.05 times": (1.45 * POINTS, {}, ""),
    "grown past 1.6 times a gentle stretch": (1.3 * POINTS, GENTLE, "swollen: "),
    "grown under a requested pressure": (3.0 * POINTS, under(50.0), ""),
    "crumpled": (0.94 * POINTS, {}, CRUMPLED),
    "sunk": (WIDE, {}, SANK),
    **{
        f"{name} {where}": (points, fields, "")
        for name, points in (("sunk", WIDE), ("crumpled", 0.94 * POINTS))
        for where, fields in (
            ("below a sphere", {"sphere": [Sphere(position=(0.0, 9.0, 0.0))]}),
            ("below a press", above(0.0, 9.0, 0.0, motion=[(0.0, (0.0, 9.0, 0.0)), (1.0, (0.0, 8.0, 0.0))])),
            ("under a requested pressure", under(1.0)),
        )
    },
    "shrunk to 27%": (0.65 * POINTS, under(1.0), ""),
    "shrunk": (0.6 * POINTS, {}, "collapsed: mesh collapsed to 22% of the volume of its mesh; more pressure, "),
    "flat": (POINTS * np.array([1.0, 0.1, 1.0]), {}, "collapsed: "),
    "a sheet, which needs no volume": (SHEET.points, {"mesh": SHEET}, ""),
    "a sheet that shrank": (0.4 * SHEET.points, {"mesh": SHEET}, "collapsed: "),
    "a part that went a little": (two_balls(1.2).points, APART, ""),
    "a part that drifted off": (two_balls(3.0).points, APART, DRIFTED),
    "falling": (LOW, DOWN, FOREVER),
    "falling to a ground": (LOW, {"speed": 1.0}, ""),
    "rising": (LOW, DOWN | {"speed": -1.0}, ""),
    "on a string": (LOW, tied(), ""),
    "on a string that was cut": (LOW, tied(end=0.0), FOREVER),
    "fixed": (LOW, DOWN | {"balloon": [Balloon(mesh=BALL, fixed=[0])]}, ""),
    "above an obstacle": (LOW, above(0.0, -7.0, 0.0), ""),
    "beside an obstacle": (LOW, above(3.0, -7.0, 0.0), FOREVER),
    "below an obstacle": (LOW, above(0.0, -3.0, 0.0), FOREVER),
    "above a slope": (LOW, above(0.0, -9.0, 0.0, shape="plane", rotation=(30.0, 0.0, 0.0)), ""),
    "below a ceiling": (LOW, above(0.0, 2.0, 0.0, shape="plane", rotation=(180.0, 0.0, 0.0)), FOREVER),
    "above where an obstacle goes": (LOW, above(0.0, -3.0, 0.0, motion=[(0.0, (0.0, -4.0 * SIZE, 0.0))]), ""),
}  # fmt: skip
"""Points at the end, what there is around, and the beginning of the kind and the sentence, if it is bad"""


@pytest.mark.parametrize("name", ENDINGS)
def test_a_bad_ending_is_told_and_a_good_one_is_not(name: str):
    """A balloon may grow, by our default pressure, to 1.6 times the volume of a ball's, 3.1 times its own."""
    points, fields, said = ENDINGS[name]
    found = [f"{ending.kind}: {ending}" for ending in endings(points, **fields)]
    assert len(found) == bool(said)
    assert all(each.startswith(said) for each in found)


@pytest.mark.full
def test_a_balloon_that_swallowed_a_part_of_itself_or_shows_its_inside_says_so():
    """A hook's end went into its beginning, and a ball's top through its bottom; a mesh's own defects do not count."""
    open_hook, closed_hook = hook(0.3), hook(-0.9)
    rise = np.append(np.repeat(np.linspace(-0.1, 0.1, 48), 12), [-0.1, 0.1])  # so that the ends do not coincide
    closed_hook.points[:, 2] += rise
    assert endings(open_hook.points, open_hook) == []
    (ending,) = endings(closed_hook.points, open_hook)
    assert ending.kind == "swallowed"
    assert str(ending).startswith("mesh swallowed ")
    assert 0.1 < ending.measure < 0.4  # two ends of 0.9 and their cones, of a ring of 6.3
    assert endings(closed_hook.points, closed_hook) == []
    through, top = POINTS.copy(), POINTS[:, 1] > 0.7
    through[top, 1] -= 1.9
    (ending,) = endings(through, **under(1.0))
    assert str(ending).startswith("mesh turned inside out in part: ")


def test_a_balloon_turned_inside_out_or_creased_has_folded():
    (ending,) = endings(-POINTS)
    assert (ending.kind, ending.measure) == ("folded", pytest.approx(-1.0))
    dented = POINTS.copy()
    top = dented[:, 1] > 0.3 * dented[:, 1].max()
    dented[top, 1] = 0.6 * dented[:, 1].max() - dented[top, 1]  # mirrored: a sharp crease around it
    (ending,) = endings(dented, **under(1.0))
    assert ending.kind == "folded"
    assert 0.01 < ending.measure < 0.2


CUBES = [Balloon(mesh=cube(), damping=1e-30, inflation=Inflation(pressure=0.0))]
FALLING = Scene(frames=63, gravity=9.9, balloon=CUBES, substeps=8)
FALLS = "mesh falls forever: 5 times its size below the start; a [ground] would stop it"


def test_a_run_says_it_in_a_sentence_and_in_its_summary(tmp_path):
    warnings: list[str] = []
    summary = animate(FALLING, tmp_path / "fall.usdc", device="cpu", on_warning=warnings.append)
    assert warnings == [FALLS]
    (said,) = json.loads(json.dumps(summary.as_json()))["bad_endings"]
    assert (said["kind"], said["balloon"]) == ("falling", "mesh")
    assert said["measure"] == pytest.approx(0.5 * 9.9 * (63 / 60) ** 2, rel=0.01)  # the step adds 0.002


def test_a_batch_says_it_of_the_worlds_that_it_exports(tmp_path):
    lift, warnings = {"balloon.helium": [0.0, 9.9, 9.9, 0.0, 0.0]}, list[str]()  # two are light enough to float
    summary = run_batch(FALLING, tmp_path, 5, lift, export=[0, 1, 2, 3], device="cpu", on_warning=warnings.append)
    assert warnings == [f"world 0: {FALLS} (and 1 more like it)"]
    assert [str(ending) for ending in summary.bad_endings] == [f"world 0: {FALLS}", f"world 3: {FALLS}"]
    assert run_batch(FALLING, tmp_path, 5, lift, device="cpu").bad_endings == []


CUBE = cube()
"""of one meter, with 8 particles"""
LIMP = {"stiffness": Stiffness(structural=0.0, shear=0.0, flexion=0.0), "inflation": Inflation(k_normal=0.0)}


def scene(**balloon: object) -> Scene:
    return Scene(balloon=[Balloon(mesh=CUBE, **balloon)], sphere=[Sphere(position=(0.0, 4.0, 0.0))] * 2)


def found(points: np.ndarray, spheres: np.ndarray, device: str, **balloon: object) -> list[int]:
    """Return the first bad particle or sphere of each world, and require that the number of threads does not matter."""
    simulator = Simulator(scene(**balloon), device, world_count=len(points))
    for array, values in ((simulator.state.points, points), (simulator.state.sphere_positions, spheres)):
        wp.copy(array, wp.array(values, dtype=wp.vec3, device=device))
    found_bad = []
    for threads in (None, 1, 3, 20):
        simulator.state.first_bad.fill_(HEALTHY)
        HealthCheck(simulator.model, threads).look(simulator.state)
        found_bad.append(simulator.state.first_bad.numpy().tolist())
    assert all(each == found_bad[0] for each in found_bad)
    return found_bad[0]


def places(worlds: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the places of particles and spheres at the start."""
    return np.tile(CUBE.points, (worlds, 1, 1)), np.tile([0.0, 4.0, 0.0], (worlds, 2, 1))


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf, 3e38, 2.0 * MOST_SPAN])
def test_a_particle_that_is_no_place_or_away_from_its_balloon_is_bad(bad: float, device: str):
    """A sphere has a number after the particles."""
    points, spheres = places(3)
    points[1, 5, 2] = bad
    spheres[2, 1, 0] = bad if abs(bad) > FARTHEST or np.isnan(bad) else 2.0 * FARTHEST
    assert found(points, spheres, device) == [HEALTHY, 5, 8 + 1]


def test_when_the_particle_that_spans_are_taken_from_is_bad_the_world_is(device: str):
    points, spheres = places(3)
    points[0, CUBE.face_vertex_indices[0]] = 2.0 * MOST_SPAN
    points[2, CUBE.face_vertex_indices[0]] = np.nan
    assert [bad != HEALTHY for bad in found(points, spheres, device)] == [True, False, True]


def test_a_balloon_that_is_far_away_as_a_whole_is_good_until_float32_does_not_resolve_it(device: str):
    points, spheres = places(2)
    points += np.array([0.5, 2.0])[:, None, None] * FARTHEST
    assert found(points, spheres, device) == [HEALTHY, int(CUBE.face_vertex_indices[0])]


def test_what_is_burst_fixed_or_unused_is_good_wherever_it_is(device: str):
    points, spheres = places(1)
    assert found(0.1 * MOST_SPAN * points, spheres, device) == [HEALTHY]  # parts thousands of its sizes apart
    points[0, 5] = 10.0 * MOST_SPAN
    assert found(points, spheres, device, fixed=[5]) == [HEALTHY]


SCHEDULES = ("scatter", "gather", "block", "lanes", "octets")
OF_KIND = {"penalty": {}, "impulse": {"contact": "impulse"}, "gas": {"balloon.inflation.kind": "gas"}}
"""settings by which the kernels of `block` differ"""


@pytest.mark.parametrize("kind", OF_KIND)
@pytest.mark.parametrize("substeps", [1, 2])
@pytest.mark.parametrize("schedule", SCHEDULES)
def test_each_schedule_looks_at_what_a_frame_wrote(schedule: str, substeps: int, kind: str, device: str):
    one = Balloon(mesh=CUBE, stiffness=LIMP["stiffness"])
    apart = scene().model_copy(update={"balloon": [one, one.model_copy(update={"position": (3.0, 0.0, 0.0)})]})
    settings = {"substeps": substeps, "balloon.fixed": [7], **OF_KIND[kind]}
    try:
        simulator = Simulator(override_scene(apart, settings.items()), device, world_count=5, schedule=schedule)
    except InputError as refusal:  # of a feature that a schedule does not have
        pytest.skip(str(refusal))
    points, spheres = simulator.state.points.numpy(), simulator.state.sphere_positions.numpy()
    if kind != "gas":  # that would fill all the space up to there
        points[0, 7] = 10.0 * MOST_SPAN  # fixed
    points[1, 13, 1] = np.nan
    points[2, 5, 2] = 10.0 * MOST_SPAN
    spheres[4, 1, 0] = 10.0 * FARTHEST
    simulator.state.points.assign(points)
    simulator.state.sphere_positions.assign(spheres)
    simulator.advance()
    well, second, first, untouched, sphere = simulator.state.first_bad.numpy().tolist()
    assert (well, untouched, sphere) == (HEALTHY, HEALTHY, 16 + 1)
    assert 8 <= second <= 13
    assert 0 <= first <= 5
    assert simulator.state.frame.numpy().tolist() == [1]


def test_a_bad_particle_is_named_by_its_number(schedule, device):
    ball = Balloon(mesh=quad_sphere(14), **LIMP)
    simulator = Simulator(Scene(balloon=[ball], substeps=2), device, schedule=schedule)
    points = simulator.state.points.numpy()
    points[0, 1000] = 1e13
    simulator.state.points.assign(points)
    simulator.advance()
    assert simulator.state.first_bad.numpy() == [1000]


def test_only_the_frames_since_the_last_kept_state_are_simulated_again(device, monkeypatch):
    """States are kept at frames 1, 9 and 17; in the second substep of frame 21 the inflation has begun to rise."""
    monkeypatch.setattr("balloon_warp.blow_ups.KEPT_FRAMES", 8)
    rises = Inflation(k_normal=[(0.0, 0.0), (20.5 / 60.0, 0.0), (21.5 / 60.0, 9e11)])
    simulator = Simulator(Scene(balloon=[Balloon(mesh=cube(), inflation=rises)], substeps=4), device)
    frames: list[int] = []
    advance = Simulator.advance

    def counted(self: Simulator) -> None:
        frames.append(self.frame_number + 1)
        advance(self)

    monkeypatch.setattr(Simulator, "advance", counted)
    report = blow_up(simulator)
    assert (report.frame, report.substep) == (21, 2)
    assert frames == [*range(1, 22), *range(17, 21)]
