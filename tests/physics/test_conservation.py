"""Closed forms of one balloon: conservation, gravity, helium, damping, outer forces, films in blocks, its frames."""

import io
from dataclasses import replace
from typing import Literal

import numpy as np
import pytest
import warp as wp
from conserved import advanced, after_each, angular_momentum, energy, masses, momentum, motion, put
from meshes import cube, mesh_of, quad_sphere
from numpy.typing import NDArray
from PIL import Image

from balloon_warp import BlowUpError, Change, Force, Frame, InputError, PolygonMesh, Scene, Simulator, Sphere, String
from balloon_warp.kernels import OPTIONS
from balloon_warp.kernels.compose import numbers_reader, params_functions
from balloon_warp.kernels.loops.membranes import membrane_faces_of
from balloon_warp.kernels.loops.quads import quads_of
from balloon_warp.kernels.memory import put_in_tile
from balloon_warp.kernels.tables import Tables
from balloon_warp.mesh.topology import signed_volume
from balloon_warp.model import build_model
from balloon_warp.scene import Atmosphere, Balloon, Inflation, Material, Stiffness
from balloon_warp.schedules.membranes import membrane_face_entries, membrane_face_layout, membrane_face_table
from balloon_warp.schedules.tables import make_tables, model_features

NO_INFLATION = Inflation(k_normal=0.0)
BALLOONS = {
    "springs": {"inflation": NO_INFLATION, "stiffness": Stiffness(variation=0.3)},
    "rubber": {"inflation": NO_INFLATION, "stiffness": Stiffness(torsion=0.02, viscosity=1e-3)},
    "pressure": {"inflation": Inflation(kind="pressure", pressure=5.0)},
    "gas": {"inflation": Inflation(kind="gas", start_pressure=5.0)},
}
FRAMES, SUBSTEPS = 200, 50
"""10000 substeps, in frames that are soon recorded"""
EPSILON = float(np.finfo(np.float32).eps)


def thrown(device: str, balloon: dict | None = None, **fields) -> Simulator:
    """Return a balloon in vacuum that flies, spins, is stretched unevenly, and trembles; a step is a millisecond."""
    ball = Balloon(mesh=quad_sphere(3, radius=0.5), mass=0.5, damping=0.0, **(balloon or BALLOONS["springs"]))
    setting = {"gravity": 0.0, "atmosphere": Atmosphere(density=0.0), "frames_per_second": 20.0, "substeps": SUBSTEPS}
    simulator = Simulator(Scene(balloon=[ball], **setting | fields), device)
    points, _ = motion(simulator)
    random = np.random.default_rng(1)
    points = points * (1.1, 0.95, 1.0) + random.normal(scale=0.02, size=points.shape)
    spin = np.cross((0.5, 1.0, 2.0), points)
    put(simulator, points, spin + (0.2, -0.1, 0.1) + random.normal(scale=0.05, size=points.shape))
    return simulator


def drifts(simulator: Simulator, frames: int = FRAMES) -> tuple[NDArray, NDArray]:
    """Return the largest drifts of momentum and angular momentum, over the rounding of each: a substep rounds each
    velocity and place by up to half an epsilon of itself, to either side."""
    before = momentum(simulator), angular_momentum(simulator)
    worst, fastest, farthest = np.zeros(2), 0.0, 0.0
    for _ in range(frames):
        simulator.step()
        points, velocities = motion(simulator)
        fastest, farthest = max(fastest, np.abs(velocities).max()), max(farthest, np.abs(points).max())
        now = momentum(simulator), angular_momentum(simulator)
        worst = np.maximum(worst, [np.abs(a - b).max() for a, b in zip(now, before, strict=True)])
    rounding = EPSILON / 2.0 * np.sqrt(frames * simulator.model.substeps) * masses(simulator).sum() * fastest
    assert min(np.linalg.norm(before[0]), np.linalg.norm(before[1])) > 1e3 * rounding
    return worst, rounding * np.array([1.0, max(farthest, 1.0)])


@pytest.mark.parametrize("kind", BALLOONS)
def test_a_free_balloon_keeps_momentum_and_angular_momentum_for_10000_substeps(kind, device):
    """Springs, torsion and pressure on a closed surface have no net force and torque, and symplectic Euler keeps both
    momenta, since x x v is the same before and after x += h v."""
    drift, rounding = drifts(thrown(device, BALLOONS[kind]))
    assert (drift < rounding).all()


def test_forward_euler_keeps_momentum_and_not_angular_momentum(device):
    """Forward Euler gains h^2 v x F of angular momentum each step, as points move by the old velocities."""
    drift, rounding = drifts(thrown(device, solver="forward_euler", substeps=2 * SUBSTEPS), frames=20)
    assert drift[0] < rounding[0]
    assert drift[1] > 1e2 * rounding[1]


def test_projective_keeps_momentum_and_loses_angular_momentum_at_first_order(device):
    """Backward Euler loses h^2 v x F of angular momentum each step, so half with half the step; its linear system,
    solved in float32, leaves less than an epsilon of the momentum every substep."""
    lost = []
    for substeps in (40, 80, 160):  # a fiftieth of a second
        simulator = thrown(device, solver="projective", substeps=substeps, frames_per_second=50.0)
        drift, rounding = drifts(simulator, frames=1)
        assert drift[0] < substeps * EPSILON * np.linalg.norm(momentum(simulator))
        assert drift[1] > 10.0 * rounding[1]
        lost.append(drift[1])
    np.testing.assert_allclose(np.log2(np.array(lost[:-1]) / lost[1:]), 1.0, atol=0.1)  # the next term is a fiftieth


def energies(simulator: Simulator, frames: int) -> NDArray[np.float64]:
    """Return the energy at the start and after each frame [J]."""
    return np.array([energy(simulator), *after_each(simulator, frames, energy)])


def test_the_energy_of_a_free_balloon_swings_within_bounds_for_10000_substeps(device):
    """The motion is chaotic, and `scatter` sums in another order every time on a GPU: of 40 starts a micrometer apart
    the largest swings were 0.013 to 0.026."""
    found = energies(thrown(device), FRAMES)
    assert np.abs(found / found[0] - 1.0).max() < 0.04


Solver = Literal["symplectic_euler", "forward_euler"]
SOLVERS: list[Solver] = ["symplectic_euler", "forward_euler"]
STIFFNESS, MASS = 50.0, 0.1
OMEGA = np.sqrt(2.0 * STIFFNESS / MASS)
"""of two particles on a spring [1/s]: each feels twice the change of length that it makes"""
STRETCH = 0.1
"""at the start [m], of a spring one meter long"""


def two_particles(solver: Solver, substeps: int, device: str) -> Simulator:
    """Return two particles on a stretched spring, let go: the length is 1 + STRETCH cos(OMEGA t)."""
    pair, spring = mesh_of([[-0.5, 0, 0], [0.5, 0, 0]], [[0, 1]]), Stiffness(structural=STIFFNESS)
    balloon = Balloon(mesh=pair, mass=2.0 * MASS, damping=0.0, stiffness=spring, inflation=NO_INFLATION)
    simulator = Simulator(Scene(balloon=[balloon], gravity=0.0, solver=solver, substeps=substeps), device)
    stretch(simulator, 1.0 + STRETCH)
    return simulator


def stretch(simulator: Simulator, factor: float) -> None:
    put(simulator, factor * motion(simulator)[0])


@pytest.mark.parametrize("solver", SOLVERS)
def test_the_spring_keeps_to_its_analytic_motion_at_first_order(solver: Solver, device: str):
    def error(substeps: int) -> float:
        simulator, worst = two_particles(solver, substeps, device), 0.0
        for frame in range(1, 25):  # two periods
            length = np.ptp(simulator.step().points[0][:, 0])
            worst = max(worst, abs(length - 1.0 - STRETCH * np.cos(OMEGA * frame / 60.0)))
        return worst

    errors = [error(substeps) for substeps in (100, 200, 400)]
    assert errors[0] < 0.2 * STRETCH
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    np.testing.assert_allclose(orders, 1.0, atol=0.15)  # the next term of the error is a tenth here


def test_forward_euler_gains_the_energy_that_it_must(device):
    """Forward Euler multiplies the energy of a linear spring by exactly 1 + (h omega)^2 a step."""
    h = 1.0 / 60.0 / 50
    found = energies(two_particles("forward_euler", 50, device), frames=24)
    expected = found[0] * (1.0 + (h * OMEGA) ** 2) ** (50 * np.arange(25))
    assert expected[-1] > 1.1 * found[0]
    # lengths near 1 m are rounded by 6e-8 m, of a stretch of 0.1 m: 1e-6, added up over some ten frames
    np.testing.assert_allclose(found, expected, rtol=1e-4)


def test_symplectic_eulers_energy_swings_and_does_not_drift(device):
    """Symplectic Euler conserves the modified energy E - h/2 k x v exactly: E stays within h omega / 2 of it."""
    h = 1.0 / 60.0 / 50
    found = energies(two_particles("symplectic_euler", 50, device), frames=240)
    swing = found / found[0] - 1.0
    assert 0.5 * h * OMEGA / 2.0 < np.abs(swing).max() < 1.05 * h * OMEGA / 2.0
    assert abs(swing[-120:].mean() - swing[:120].mean()) < 0.1 * h * OMEGA / 2.0


@pytest.mark.parametrize("solver", SOLVERS)
def test_the_stable_step_is_exact_for_two_particles_on_a_spring(solver: Solver, device: str):
    """Gershgorin's bound: w^2 h^2 + 2 g h = 4 where the spring is viscous, or h = g / w^2 by forward Euler, whose
    balloon is damped. A step a hundredth longer gains energy, and one a hundredth shorter loses it."""
    rate = 0.2 * OMEGA
    viscous = {"stiffness": Stiffness(structural=STIFFNESS, viscosity=rate / OMEGA**2)}
    slowed = viscous if solver == "symplectic_euler" else {"damping": rate * 2.0 * MASS}
    limit = (np.hypot(rate, 2.0 * OMEGA) - rate) / OMEGA**2 if solver == "symplectic_euler" else rate / OMEGA**2
    scene = two_particles("symplectic_euler", 50, "cpu").model.scene
    damped = scene.balloon[0].model_copy(update=slowed)
    auto = {"solver": solver, "balloon": [damped], "substeps": "auto", "frames_per_second": 1.0 / (100.2 * limit)}
    model = build_model(scene.model_copy(update=auto), device)
    assert model.substeps == 126  # the next number above 100.2 / 0.8
    for part, grows in ((1.01, True), (0.99, False)):
        simulator = Simulator.of_model(replace(model, frame_seconds=200.0 * part * limit, substeps=200))
        stretch(simulator, 1.0 + STRETCH)
        found = energies(simulator, frames=5)
        assert (found[-1] > found[0]) == grows


def test_auto_takes_the_step_at_which_damping_makes_up_for_forward_euler():
    balloon = Balloon(mesh=quad_sphere(3), damping=2.0)
    symplectic, forward = (build_model(Scene(balloon=[balloon], solver=solver), "cpu").substeps for solver in SOLVERS)
    assert forward > 2 * symplectic
    with pytest.raises(InputError, match=r"^substeps: forward Euler without damping gains energy at every step"):
        Simulator(Scene(balloon=[balloon.model_copy(update={"damping": 0.0})], solver="forward_euler"), "cpu")


FLOAT32 = 1.2e-7
"""relative rounding of float32"""


def triangle_balloon(stiffness: float = 50.0, **fields) -> Balloon:
    """Return an equilateral triangle, corners one meter from the origin, in the x-y plane."""
    angles = np.radians([90.0, 210.0, 330.0])
    corners = np.stack([np.cos(angles), np.sin(angles), np.zeros(3)], axis=1)
    fields = {"mass": 0.3, "damping": 0.0, "inflation": NO_INFLATION} | fields
    return Balloon(mesh=mesh_of(corners, [[0, 1, 2]]), stiffness=Stiffness(structural=stiffness), **fields)


def simulated(scene: Scene, device: str) -> Frame:
    """Return the last frame."""
    return advanced(Simulator(scene, device), scene.frames)


def test_free_fall_is_the_listing_to_the_last_bit_but_rounding(device):
    """Symplectic Euler gives x = -g h^2 n (n + 1) / 2 after n steps, not n^2 nor n (n - 1)."""
    scene = Scene(balloon=[triangle_balloon()], gravity=2.0, frames=10, frames_per_second=10, substeps=20)
    h, n = 0.1 / 20, 200
    fallen = simulated(scene, device).points[0] - triangle_balloon().mesh.points
    # 200 additions of velocities near 1: rounding of some 200 * 1.2e-7 relative
    np.testing.assert_allclose(fallen[:, 1], -2.0 * h * h * n * (n + 1) / 2, rtol=200 * FLOAT32)
    np.testing.assert_allclose(fallen[:, [0, 2]], 0.0, atol=1e-5)


def test_helium_lifts_against_gravity_along_the_up_axis(device):
    balloon = triangle_balloon(helium=12.0)
    scene = Scene(balloon=[balloon], up_axis="Z", gravity=2.0, frames=10, frames_per_second=10, substeps=20)
    velocities = simulated(scene, device).velocities[0]
    np.testing.assert_allclose(velocities, [[0.0, 0.0, 10.0]] * 3, atol=1e-4)


def test_a_stiff_string_is_part_of_the_stable_step(device):
    balloon = triangle_balloon(fixed=[1, 2], helium=20.0, damping=6.0)
    string = String(anchor=(0.0, 0.9, 0.0), particle=0, stiffness=1e5)
    frame = simulated(Scene(balloon=[balloon], string=[string], frames=60), device)
    # exp(-10) of the ringing is left, so that float32's steps of 1e-7 m at a height of 1 m count
    np.testing.assert_allclose(frame.points[0][0], [0.0, 1.0 + 0.3 * (20.0 - 9.81) / 1e5, 0.0], atol=5e-7)
    assert np.abs(frame.velocities[0]).max() < 1e-3


@pytest.mark.parametrize("damping", [6.0, 60.0, 6000.0])
def test_heavy_damping_asks_for_no_shorter_step_and_never_turns_a_balloon_back(damping: float, device):
    """A balloon that is thrown up slows down and sinks at m g / c, however fast damping is for the step, by which it
    approaches that as 1 / (1 + c h / m) to the power of the steps."""
    balloon = triangle_balloon(damping=damping, velocity=(0.0, 1.0, 0.0))
    simulator = Simulator(Scene(balloon=[balloon], frames_per_second=600.0), device)
    undamped = Scene(balloon=[triangle_balloon()], frames_per_second=600.0)
    assert simulator.model.substeps == build_model(undamped, device).substeps == 1
    sinking, speeds = -0.3 * 9.81 / damping, [1.0]
    for _ in range(600):
        speeds.append(simulator.step().velocities[0][:, 1].mean())
    rate = 1.0 + damping / 0.3 / 600.0
    np.testing.assert_allclose(speeds, sinking + (1.0 - sinking) * rate ** -np.arange(601.0), atol=1e-4)


CUBE = Balloon(mesh=cube(), inflation={"kind": "pressure", "pressure": 50.0})
BALL = Balloon(mesh=quad_sphere(3), position=(5.0, 0.0, 0.0), scale=2.0)
LATE = Sphere(position=(0.0, 4.0, 0.0), start=1 / 60)
CHANGES = Change(time=1 / 60, set={"balloon.mass": 0.5}), Change(time=2 / 60, set={"normals": "fresh", "substeps": 100})
TWO = Scene(normals="cached", balloon=[CUBE, BALL], sphere=[LATE], change=list(CHANGES))


def test_a_frame_knows_its_time_and_its_balloons_size():
    simulator = Simulator(TWO, "cpu")
    start = simulator.read_frame()
    assert (start.number, start.time, simulator.time) == (0, 0.0, 0.0)
    assert (start.volumes[0], start.areas[0]) == pytest.approx((1.0, 6.0), rel=1e-12)
    later = advanced(simulator, 3)
    assert later.time == simulator.time == pytest.approx(3 / 60)
    assert later.volumes[0] > 1.0
    # the device sums in float64 the float32 places that the host sums, too
    np.testing.assert_allclose(later.volumes, simulator.mass_properties().volume[0], rtol=1e-9)
    assert later.pressures[0] == 50.0


def test_reset_goes_back_to_the_same_start():
    simulator = Simulator(TWO, "cpu")
    first = advanced(simulator, 4)
    for gravity in (0.0, 1.0):
        simulator.set_parameters({"gravity": gravity})
        simulator.step()
        simulator.reset()
        assert (simulator.frame_number, simulator.model.scene.normals) == (0, "cached")
        assert simulator.model.parameters["gravity"].numpy() == np.float32(9.81)
    frames = list(zip(range(5), simulator.run(), strict=False))
    np.testing.assert_array_equal(frames[4][1].points[1], first.points[1])
    np.testing.assert_array_equal(frames[4][1].sphere_positions, first.sphere_positions)


def test_a_notebook_shows_a_picture(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("balloon_warp.studio.animate.NOTEBOOK_SIZE", (64, 36))
    simulator = Simulator(TWO, "cpu")
    shown = simulator._repr_png_()
    assert shown is not None
    pixels = np.asarray(Image.open(io.BytesIO(shown)).convert("RGB")).astype(int)
    assert pixels.shape == (36, 64, 3)
    assert (pixels[..., 0] - pixels[..., 2] > 80).any()
    assert (pixels[..., 2] - pixels[..., 0] > 40).any()
    frame = simulator.read_frame()
    broken = replace(frame, points=[np.full_like(points, np.nan) for points in frame.points])
    monkeypatch.setattr(simulator, "read_frame", lambda world: broken)
    assert simulator._repr_png_() is None
    with pytest.raises(InputError, match="frame 0: has positions that are not finite"):
        simulator.picture()


def test_a_world_is_read_among_others_as_alone(device: str):
    held = Balloon(mesh=quad_sphere(3), inflation={"k_normal": 0.1})
    scene = Scene(balloon=[held], string=[String(balloon=0, anchor=(0.0, 3.0, 0.0), length=1.0)], net_forces=True)
    vary = {"balloon.inflation.k_normal": [0.1, 0.2, 0.4], "string.length": [1.0, 1.1, 1.2]}
    simulator = Simulator(scene, device, world_count=3, vary=vary, schedule="gather")
    alone = Simulator(scene, device, world_count=1, vary={k: v[2:] for k, v in vary.items()}, schedule="gather")
    for _ in range(3):
        simulator.step()
        others, read, expected = simulator.read_frame(0), simulator.read_frame(2), alone.step()
        for name in ("points", "velocities", "net_forces", "inflation_forces"):
            np.testing.assert_array_equal(getattr(read, name)[0], getattr(expected, name)[0])
            assert (getattr(read, name)[0] != getattr(others, name)[0]).any()
        np.testing.assert_array_equal(read.string_anchors, expected.string_anchors)


def test_frames_that_are_read_while_the_next_is_simulated_are_the_same(device: str):
    scene = TWO.model_copy(update={"frames": 6})
    ahead, simulator = [], Simulator(scene, device)
    for frame in simulator.run(ahead=True):
        ahead.append((simulator.frame_number - frame.number, frame))
    assert [lead for lead, _ in ahead] == [0, 0, 0, 1, 1, 1, 0]  # waits where something changes, and at the end
    for (_, one), other in zip(ahead, Simulator(scene, device).run(), strict=True):
        assert (one.number, one.time) == (other.number, other.time)
        np.testing.assert_array_equal(one.points[1], other.points[1])
        np.testing.assert_array_equal(one.velocities[0], other.velocities[0])
        np.testing.assert_array_equal(one.sphere_positions, other.sphere_positions)
        np.testing.assert_array_equal(one.pressures, other.pressures)


@pytest.mark.parametrize("ahead", [False, True])
def test_a_blow_up_ends_the_frames_after_the_last_good_one(device: str, ahead: bool):
    scene = Scene(balloon=[Balloon(mesh=cube(), inflation={"k_normal": 1e9})], substeps=1, normals="fresh", frames=20)
    frames, numbers = Simulator(scene, device, world_count=2).run(ahead=ahead), []
    with pytest.raises(BlowUpError) as told:
        numbers.extend(frame.number for frame in frames)
    assert numbers == list(range(len(numbers)))
    assert f"in frame {len(numbers)}, world 0" in str(told.value)


DRIVEN_MASS = 0.1
GROUPED = replace(quad_sphere(3, 0.5), groups={"nose": np.array([0, 4, 9]), "tail": np.array([20, 21])})
FLOATING = Balloon(mesh=GROUPED, mass=DRIVEN_MASS, damping=0.0, inflation=Inflation(k_normal=0.0))
SCENE = Scene(balloon=[FLOATING], gravity=0.0, substeps=24, force=[Force(particles=["nose", 30]), Force()])
FEW = 3
NOSE, ALL = "force.0.newtons", "force.1.newtons"
GIVEN = np.array([[0.0, 0.0, 0.0], [0.02, -0.01, 0.03], [-0.01, 0.02, 0.0]], dtype=np.float32)


def driven(device: str, worlds: slice = slice(None), scene: Scene = SCENE) -> Simulator:
    """Return worlds that were driven at the nose, and then as a whole, too."""
    given = GIVEN[worlds]
    simulator = Simulator(scene, device, len(given))
    for frame in range(FEW):
        simulator.controls[NOSE] = given
        simulator.controls[ALL] = 0.5 * frame * given
        simulator.step_unread()
    return simulator


def momenta(simulator: Simulator) -> np.ndarray:
    """Return the momentum of each world [kg m/s]."""
    velocities = np.asarray(simulator.state.velocities.numpy(), dtype=np.float64)
    return np.einsum("p, wpk -> wk", DRIVEN_MASS * simulator.model.particle_mass_share.numpy(), velocities)


@pytest.mark.parametrize("solver", ["symplectic_euler", "forward_euler", "projective"])
def test_momentum_grows_by_force_times_time(solver: str, device: str) -> None:
    """Springs add nothing to it: to float32's rounding, and for the implicit solver to its iterations' residual."""
    simulator = driven(device, scene=SCENE.model_copy(update={"solver": solver}))
    told = GIVEN / 60.0 * sum(1.0 + 0.5 * frame for frame in range(FEW))
    np.testing.assert_allclose(momenta(simulator), told, atol=2e-5 * np.abs(told).max())
    points = simulator.state.points.numpy()
    assert np.abs(points[1] - points[0]).max() > 1e-3


def test_a_group_shares_a_force_by_mass_but_for_what_is_fixed() -> None:
    held = FLOATING.model_copy(update={"fixed": [4]})
    softer = held.model_copy(update={"stiffness": held.stiffness.model_copy(update={"even": True})})
    simulator = Simulator(SCENE.model_copy(update={"balloon": [softer]}), "cpu")
    shares, driven = simulator.model.particle_mass_share.numpy(), simulator.model.driven
    of_nose = driven.forces == 0
    assert driven.particles[of_nose].tolist() == [0, 9, 30]
    np.testing.assert_allclose(driven.shares[of_nose], shares[[0, 9, 30]] / shares[[0, 9, 30]].sum(), rtol=1e-6)
    assert driven.shares.sum() == pytest.approx(2.0)
    before = simulator.state.points.numpy()[0, 4]
    simulator.controls[ALL] = [[0.0, 1.0, 0.0]]
    np.testing.assert_array_equal(simulator.step().points[0][4], before)


def test_what_is_driven_too_hard_says_so() -> None:
    simulator = Simulator(SCENE, "cpu")
    simulator.controls[NOSE] = [[1e9, 0.0, 0.0]]
    with pytest.raises(BlowUpError, match=r"outer forces pushed it with"):
        simulator.step()


@pytest.mark.parametrize(
    ("fields", "sentence"),
    [
        ({"particles": ["beak"]}, r"force\.0\.particles: mesh has no group beak; it has nose, tail"),
        ({"particles": [99]}, r"force\.0\.particles: mesh has particles 0 to 55 \(got 99\)"),
        ({"particles": []}, r"particles: must be a list of at least one item \(got \[\]\)"),
        ({"balloon": 1}, r"force\.0\.balloon: must be below the number of balloons, 1 \(got 1\)"),
        ({"particles": ["tail"]}, r"force\.0\.particles: all its particles are fixed in mesh"),
        ({"newtons": 3.0}, r"newtons: must be "),
    ],
)
def test_a_force_that_cannot_act_is_refused(fields: dict, sentence: str) -> None:
    held = FLOATING.model_copy(update={"fixed": ["tail"]})
    with pytest.raises(InputError, match=sentence):
        Simulator(Scene(balloon=[held], force=[Force(**fields)]), "cpu")


QUADS = quad_sphere(3, 0.1)
TRIANGLES = mesh_of(QUADS.points.tolist(), [c for a, b, d, e in QUADS.face_vertex_indices.reshape(-1, 4).tolist()
                                            for c in ([a, b, d], [a, d, e])])  # fmt: skip


def measured(mesh: PolygonMesh, points: np.ndarray, held: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the pull of faces on particles [N], and their area vectors [m^2], by threads that keep so many quads."""
    empty, rubber = Inflation(kind="gas", start_pressure=0.0), Material(preset="latex", kind="neo_hookean")
    scene = Scene(balloon=[Balloon(mesh=mesh, material=rubber, inflation=empty, damping=0.0)])
    model = build_model(scene, "cpu")
    features = model_features(model)
    membrane_face = membrane_face_layout(model, features)
    assert membrane_face is not None
    assert membrane_face.areas
    count, threads = model.particle_count, -(-model.face_count // held) if held else 1
    membrane_face = membrane_face._replace(quads=held, room=held * threads, capacity=count)
    membrane_face = membrane_face._replace(tile=membrane_face_entries(model, membrane_face))
    places, faces = membrane_face.tile, model.face_count
    tables = make_tables(model, features, in_block=True)
    tables.membranes.membrane_faces = membrane_face_table(model, membrane_face)
    membrane_faces = membrane_faces_of(features, membrane_face)
    quads = quads_of(features, membrane_face) if held else None
    hold, stretch = (quads.hold, quads.stretch) if quads else (None, None)
    read_numbers = numbers_reader(features.columns)
    _, read_params = params_functions(features.columns, features.balloons)

    @wp.kernel(module="unique", enable_backward=False, module_options=OPTIONS)
    def measure(
        t: Tables,  # pyright: ignore[reportGeneralTypeIssues] - a struct
        points: wp.array[wp.vec3],
        velocities: wp.array[wp.vec3],
        pulled: wp.array[wp.vec3],
        found: wp.array[wp.vec3],
    ):
        tile = wp.tile_empty(shape=count, dtype=wp.vec3, storage="shared")
        pulls = wp.tile_full(shape=places, dtype=wp.vec4, value=wp.vec4(1.0), storage="shared")
        areas = wp.tile_full(shape=places, dtype=wp.vec2, value=wp.vec2(1.0), storage="shared")
        for particle in range(count):
            put_in_tile(tile, particle, points[particle])
        membrane_faces.clear(t, pulls, areas)
        if wp.static(quads is not None):
            for thread in range(threads):
                n = read_numbers(t, 0, 0)
                stretch(t, 0, thread, n, hold(t, 0, n, thread), tile, pulls, areas)  # pyright: ignore
        else:
            for face in range(faces):
                membrane_faces.stretch(t, 0, face, tile, velocities, pulls, areas)
        for particle in range(count):
            params = read_params(t, 0, particle)
            read = membrane_faces.read_places(t, params, True)
            pull, area_vector = membrane_faces.take(t, params, read, pulls, areas)
            pulled[particle] = pull
            found[particle] = area_vector

    velocities, pulled, found = (wp.zeros(count, dtype=wp.vec3, device="cpu") for _ in range(3))
    given = [tables, wp.array(points, dtype=wp.vec3, device="cpu"), velocities, pulled, found]
    wp.launch_tiled(measure, dim=[1], inputs=given, block_dim=1, device="cpu")
    return pulled.numpy(), found.numpy()


def moved(mesh: PolygonMesh, stretch: float) -> np.ndarray:
    """Return a mesh's points, stretched and jittered in and out."""
    rng = np.random.default_rng(0)
    return (stretch * np.asarray(mesh.points) * rng.uniform(0.9, 1.1, (len(mesh.points), 1))).astype(np.float32)


@pytest.mark.always("mesh1-1", "mesh3-0")
@pytest.mark.parametrize(("mesh", "held"), [(QUADS, 0), (QUADS, 1), (QUADS, 2), (TRIANGLES, 0)])
def test_area_vectors_are_the_gradient_of_the_volume(mesh: PolygonMesh, held: int) -> None:
    """Area vectors equal central differences of the volume, exact but for rounding: it is cubic in each place."""
    points = moved(mesh, 1.0)
    _, found = measured(mesh, points, held)
    np.testing.assert_allclose(found, gradient(mesh, points.astype(np.float64)), atol=1e-7)


@pytest.mark.always(*(f"{stretch}-1" for stretch in ("slack", "wrinkled here and there", "taut")))
@pytest.mark.parametrize("held", [1, 2])
@pytest.mark.parametrize("stretch", [0.9, 1.1, 1.6], ids=["slack", "wrinkled here and there", "taut"])
def test_quads_pull_alike_whether_threads_keep_them(stretch: float, held: int) -> None:
    """Forces of quads agree whether or not threads keep their data, up to float32's rounding; and they sum to zero."""
    points = moved(QUADS, stretch)
    kept, read = (measured(QUADS, points, each)[0] for each in (held, 0))
    largest = np.abs(read).max()
    assert largest > 0.0
    np.testing.assert_allclose(kept, read, atol=2e-5 * largest)
    np.testing.assert_allclose(kept.sum(axis=0), 0.0, atol=1e-5 * largest)


def gradient(mesh: PolygonMesh, points: np.ndarray, step: float = 1e-4) -> np.ndarray:
    """Return the gradient of the enclosed volume by each place [m^2]."""
    found = np.zeros_like(points)
    for place in np.ndindex(*points.shape):
        for sign in (1.0, -1.0):
            moved = points.copy()
            moved[place] += sign * step
            found[place] += sign * signed_volume(replace(mesh, points=moved)) / (2.0 * step)
    return found


def test_stable_step_holds_and_is_not_wasteful(device):
    balloon = Balloon(mesh=quad_sphere(4), damping=0.0, inflation=NO_INFLATION)
    scene = Scene(balloon=[balloon], gravity=0.0, frames_per_second=6, frames=20)
    fewest = int(0.801 * Simulator(scene, device).model.substeps)  # "auto" takes 0.8 of the stable step
    simulator = Simulator(scene.model_copy(update={"substeps": fewest}), device)
    kick = np.random.default_rng(1).normal(0.0, 0.01, (simulator.model.particle_count, 3))
    put(simulator, velocities=kick)
    # all the energy is kinetic at first, so the rms speed can hardly grow while the scheme is stable
    assert np.std(advanced(simulator, 20).velocities[0]) < 1.5 * np.std(kick)
    with pytest.raises(InputError, match=r"^substeps: \d+ are too few .* at least \d+ are needed"):
        Simulator(scene.model_copy(update={"substeps": fewest // 2}), device)
