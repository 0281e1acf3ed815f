"""Report of a blow-up, where frame, substep, particle, spring and step are known."""

import re
from collections import deque
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from meshes import cube, mesh_of

from balloon_warp import BlowUpError, Simulator
from balloon_warp.blow_ups import BlowUp
from balloon_warp.kernels.tables import HEALTHY
from balloon_warp.scene import Atmosphere, Balloon, Change, Ground, Inflation, Scene, Sphere, Stiffness, String
from balloon_warp.schedules.frames import MOST_SPAN

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
def test_of_two_springs_the_one_that_pulled_harder_is_named(device):
    """The report names the spring that pulled harder: the second goes sideways to particle 2, half as stiff."""
    net = mesh_of([(0, 0, 0), (0, -1, 0), (5, -1, 0)], [[1, 2], [0, 1]])
    rubber = Stiffness(structural=1.0, shear=0.0, flexion=0.0, gradient=(1.0, 0.0), gradient_axis="X")
    balloon = on_a_spring().balloon[0].model_copy(update={"mesh": net, "fixed": [0, 2], "stiffness": rubber})
    report = blow_up(stiffened(Simulator(on_a_spring().model_copy(update={"balloon": [balloon]}), device)))
    assert report.body == "particle 1"
    assert report.spring.by == "the structural spring to particle 0"


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
    sentence = str(blow_up(stiffened(Simulator(on_a_spring(), device))))
    enough = int(sentence.rpartition(" substeps a frame")[0].rpartition(" ")[2])
    simulator = stiffened(Simulator(on_a_spring(), device))
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
        return blow_up(Simulator(Scene(balloon=[BESIDE, ball], frames=120, **fields), device))

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
    """Corners of the cube lie on it."""
    scene = Scene(balloon=[Balloon(mesh=cube(), inflation=TOO_MUCH)], faces=False, **obstacles)
    report = blow_up(Simulator(scene, device))
    assert report.touched == touched
    assert all(f"; it touched {name}; " in str(report) for name in touched)


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


@pytest.mark.full
def test_a_string_that_pulls_too_hard_is_named(device):
    """A string is named that is too short by the distance from its anchor, and too stiff for the step."""
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
