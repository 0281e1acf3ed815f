"""Calls of `gradient`: refusals in a sentence, checkpoints, means over samples, frameworks' losses, single springs."""
# pyright: reportAssignmentType=false, reportGeneralTypeIssues=false

import re
from dataclasses import replace
from functools import cache
from math import erf, exp, pi, sqrt
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import warp as wp
from gradient_losses import far, far_in_float64
from gradient_scenes import BALL, BELOW, BETWEEN_CORNERS, CASES, CHANGES, SPRINGS, N, exchange, scene
from meshes import quad_sphere

import balloon_warp as bw
from balloon_warp.batch.trajectories import Trajectories
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.laws.membrane import THICKNESS
from balloon_warp.kernels.phase import Access, NoAdjointError, by_grad, phase
from balloon_warp.kernels.schedules.launched import GATHERED
from balloon_warp.kernels.schedules.writer import cut, traces_of
from balloon_warp.lab.gradients import derive
from balloon_warp.lab.gradients.derive import FewFrames, LossDerivatives, evaluate_loss, min_recomputed_frames
from balloon_warp.lab.reference.step import film_of
from balloon_warp.mesh.obj import write_obj
from balloon_warp.model import build_model, plan_model
from balloon_warp.schedules.backward_launched import bytes_backwards
from balloon_warp.schedules.tables import model_features
from balloon_warp.springs.build import Membrane, build_membrane


def told(loss: Any, *slopes: Any) -> dict[str, Any]:
    """Return the arguments with a loss that is the same for any run."""
    return {"of": SPRINGS, "loss": lambda moved: (loss, *slopes) if slopes else loss}


def on_the_way(**changed: Any) -> bw.Scene:
    return scene(ground=True, frames=2, change=[{"time": 0.01, "set": changed}])


def both() -> bw.Scene:
    """Return two balls that are apart, which only launches simulate."""
    pair = [*scene().balloon, *scene(position=(4.0, 1.0, 0.0)).balloon]
    return scene().model_copy(update={"balloon": pair, "touch": False})


MASS, LENGTHS = ["balloon.mass"], ["rest_lengths"]
BOX = scene(frames=2, substeps=16, obstacle=[BELOW], faces=False)
UNDER_A_SPHERE = {"sphere": [{"position": (0.0, 3.0, 0.0), "radius": 0.6}], "contact": "impulse"}
WITH_A_SPHERE = scene(obstacle=[BELOW], faces=False, **UNDER_A_SPHERE)
CARRIED = BOX.model_copy(update={"string": [bw.String(anchor=(0.0, 3.0, 0.0), obstacle=0, length=1.0)]})
TIED = {"body": [bw.Body(position=(0.0, 4.0, 0.0))], "string": [bw.String(anchor=(0.0, 0.0, 0.0), body=0)]}
FACES_MEET_IT = scene(obstacle=[BELOW], faces=True)
NO_CHANGE = on_the_way(gravity=1.0)
REFUSED: dict[str, tuple[bw.Scene, dict[str, Any], str]] = {
    "unknown": (scene(), {"of": ["balloon.mas"]}, "balloon.0.mas: unknown field; did you mean mass?"),
    "a text": (scene(), {"of": ["balloon.name"]}, "balloon.name: cannot be derived by; expected the path of a number"),
    "no number a world": (scene(), told([1.0, 2.0], {}), "loss: expected a number for each of 1 worlds"),
    "a number alone": (scene(), told(1.0), "loss: expected two things"),
    "unknown slopes": (scene(), told(1.0, {"areas": 0.0}), "loss: has no derivatives by areas"),
    "a wrong shape": (scene(), told(1.0, {"points": [np.zeros(3)]}), "must have the shape"),
    "not finite": (scene(), told(np.nan, {}), "loss: is not finite in world 0"),
    "a correction": (scene(correction="provot"), {"of": SPRINGS},
                     "gradients: `correct` has no adjoint yet; expected a scene without"),
    "a string to a body": (BOX.model_copy(update=TIED), {"of": MASS},
                           "gradients: `pull_tied_bodies` has no adjoint yet; expected"),
    "gather": (both(), {"of": MASS, "schedule": "gather"},
               "schedule: expected auto, launched, block or lanes, which run backwards (got 'gather')"),
    "lanes of two": (both(), {"of": MASS, "schedule": "lanes"},
                     "schedule: lanes runs one balloon of springs or rubber backwards on a CPU"),
    "a string": (CASES["a viscous ball on a string"].scene, {"of": ["string.0.length"], "schedule": "block"},
                 "string.0.length: is derived by launches; expected the schedule launched"),
    "substeps that change": (on_the_way(substeps=40), {"of": MASS},
                             "change.0.set: substeps: has no adjoint if it changes on the way"),
    "no such change": (NO_CHANGE, {"of": ["change.1.set.gravity"]},
                       "the scene has 1 changes; expected change.NUMBER"),
    "not set": (NO_CHANGE, {"of": ["change.0.set.balloon.mass"]},
                "change 0 sets no number there; expected one of what"),
    "friction that changes": (on_the_way(**{"ground.friction": 0.1}), {"of": ["change.0.set.ground.friction"]},
                              "cannot be derived by yet, for it acts by"),
    "no obstacle": (BOX, {"of": ["obstacle.3.motion.0.1.0"]},
                    "the scene has 1 obstacles; expected obstacle.NUMBER, from 0"),
    "no keyframe": (BOX, {"of": ["obstacle.0.motion.7.1.0"]},
                    "obstacle 0 has 3 keyframes; expected obstacle.0.motion.KEYFRAME.1.AXIS"),
    "the anchor that an obstacle carries": (CARRIED, {"of": ["string.0.anchor.0"]},
                                            "string.0.anchor.0: cannot be derived by yet, for it acts by"),
    "the way of what spheres meet": (WITH_A_SPHERE, {"of": ["obstacle.0.motion.1.1.0"]},
                                     "obstacle.0.motion.1.1.0: cannot be derived by yet, for it acts by"),
    "the place of what faces meet": (FACES_MEET_IT, {"of": ["obstacle.0.position.1"]}, "cannot be derived by yet"),
    "friction where a sphere meets faces": (exchange(BETWEEN_CORNERS, 1.75, faces=True), {"of": ["sphere.1.friction"]},
                                            "sphere.1.friction: cannot be derived by yet"),
    "ground far below": (scene(ground=True, position=(0.0, 9.0, 0.0)), {"of": CASES["ground"].paths},
                         "ground.height: no path leads from it to the loss"),
    "unknown parts": (scene(), {"each": ["lengths"]}, "each: expected some of rest_lengths, spring_constants"),
    "no springs": (scene(material={"kind": "mooney_rivlin"}), {"each": LENGTHS}, "the scene has no springs"),
    "no rubber": (scene(), {"each": ["thicknesses"]}, "each: thicknesses: the scene has no rubber or film"),
    "parts in blocks": (scene(), {"each": LENGTHS, "schedule": "block"}, "each: rest_lengths: is derived by launches"),
    "no frame": (scene(frames=2), {"every": 0},
                 "every: must be a whole number from 1 to 2, the frames of the scene (got 0)"),
    "no deviation": (scene(), {"smooth": {"gravity": 0.0}},
                     "smooth: gravity: expected a standard deviation above 0 (got 0)"),
    "a sample alone": (scene(), {"smooth": {"gravity": 0.1}, "samples": 1}, "samples: expected at least 2 (got 1)"),
    "draws beyond a bound": (scene(), {"smooth": {"balloon.mass": 0.1}}, "balloon.0.mass: must be greater than 0"),
    "no checkpoint": (scene(frames=2), {"checkpoints": 0}, "checkpoints: must be at least 1 (got 0)"),
}  # fmt: skip


@pytest.mark.full
@pytest.mark.parametrize("case", REFUSED)
def test_what_cannot_be_derived_is_refused_in_a_sentence(case: str):
    of, asked, sentence = REFUSED[case]
    with pytest.raises(bw.InputError, match=re.escape(sentence)):
        bw.gradient(of, **{"of": [] if "each" in asked else SPRINGS, "loss": far, "device": "cpu"} | asked)


def test_rest_points_need_springs_that_follow_from_them(tmp_path: Path):
    of, springs = scene(), plan_model(scene()).shapes[0].springs
    lengths = 0.9 * springs.rest_lengths
    np.savez(tmp_path / "own.npz", pairs=springs.pairs, rest_lengths=lengths, constants=np.full(springs.count, 50.0))
    of = of.model_copy(update={"balloon": [of.balloon[0].model_copy(update={"springs": tmp_path / "own.npz"})]})
    with pytest.raises(bw.InputError, match="have lengths at rest of their own; expected rest_lengths"):
        bw.gradient(of, each=["rest_points"], loss=far, device="cpu")


@pytest.mark.full
def test_a_balloon_that_the_loss_knows_nothing_of_has_no_slopes():
    of = CASES["gas on the ground"].scene
    apart = [*of.balloon, of.balloon[0].model_copy(update={"position": (9.0, 1.0, 0.0)})]
    of = of.model_copy(update={"balloon": apart, "touch": False})
    found = bw.gradient(of, of=["balloon.1.velocity.1"], loss=bw.losses.height(1.0, balloon=1), device="cpu")
    assert found.by_points[0].shape == (N, 3)
    assert not found.by_points[0].any()
    assert found.by_points[1].any()


def test_a_device_keeps_little_of_each_frame():
    model = build_model(scene(), "cpu")
    few, many = (bytes_backwards(model, (), frames) for frames in (10, 10_010))
    assert many - few < 10_000 * model.particle_count * 4


@phase("particle", {"warmth": float}, keeps={"warmth": 0.0}, adjoint=by_grad)
def warm_up(features: Features, access: Access) -> Any:
    @wp.func
    def warm_up(warmth: float):
        return warmth + 1.0

    return warm_up


def test_a_phase_that_keeps_values_is_refused_by_its_name():
    features = model_features(build_model(scene(), "cpu"))
    with pytest.raises(NoAdjointError, match="`warm_up`, which keeps values"):
        traces_of(cut((warm_up,), features, GATHERED))


PATHS = [SPRINGS[0], "balloon.damping", "balloon.velocity.1", "change.0.set.balloon.damping", "change.1.set.gravity"]


@cache
def least(frames: int, free: int) -> int:
    """Return the least number of simulated frames, of all places for the next beginning that is kept."""
    if frames <= 1 or free == 0:
        return frames * (frames - 1) // 2
    return min(way + least(frames - way, free - 1) + least(way, free) for way in range(1, frames))


@pytest.mark.parametrize("most", [1, 2, 3, 5, 40])
@pytest.mark.parametrize("frames", [1, 2, 7, 20, 36])
def test_frames_are_taken_in_order_and_simulated_as_seldom_as_can_be(frames: int, most: int):
    """Frames are only counted: the state at the start of one is its number."""
    now = simulated = 0

    def keep(frame: int) -> int:
        assert frame == now
        return frame

    def go_back(frame: int, beginning: int) -> None:
        nonlocal now
        now = frame
        assert frame == beginning

    def advance(frame: int) -> None:
        nonlocal now, simulated
        assert frame == now
        now, simulated = now + 1, simulated + 1

    starts = FewFrames(frames, most, keep, go_back, advance)
    for frame in range(frames):
        starts.note(frame)
        now = frame + 1
    last_kept = starts._kept[-1][0]
    assert len(starts._kept) == min(frames, most)
    for frame in reversed(range(frames)):
        assert starts.take(frame) == frame
        assert len(starts._kept) <= most
    assert simulated + last_kept == min_recomputed_frames(frames, most - 1) == least(frames, most - 1)


def at_end(moved: Trajectories) -> tuple[Any, dict[str, Any]]:
    """Return a loss of the last frame, and of the one in the middle."""
    slopes = np.zeros(moved.points[0].shape)
    weights = np.linspace(-1.0, 1.0, 3 * N).reshape(N, 3)
    seen = [-1, (len(slopes) - 1) // 2]
    slopes[seen] = weights
    return (weights * moved.points[0][seen]).sum(), {"points": [slopes]}


def same(found: bw.Gradient, told: bw.Gradient) -> None:
    """Require the same derivatives to the bit."""
    np.testing.assert_array_equal(found.loss, told.loss)
    for path in told.gradients:
        np.testing.assert_array_equal(found.gradients[path], told.gradients[path])
    for name in ("by_points", "by_velocities"):
        np.testing.assert_array_equal(getattr(found, name)[0], getattr(told, name)[0])


@pytest.mark.full
@pytest.mark.parametrize("way", ["block", "launched", "lanes"])
def test_few_checkpoints_give_the_same_bits(way: str, device: str):
    """Parameters change in frames 2 and 4, so that the way back goes through spans and returns to later ones."""
    if way == "lanes" and device != "cpu":
        pytest.skip("lanes are a CPU's")
    of = scene(frames=20, rate=240.0, substeps=4, change=CHANGES)
    asked: dict[str, Any] = {"of": PATHS, "loss": at_end, "device": device, "schedule": way}
    told = bw.gradient(of, **asked)
    for most in (3, 1):
        same(bw.gradient(of, checkpoints=most, **asked), told)
    seldom = bw.gradient(of, every=10, checkpoints=3, **asked)
    same(seldom, told)
    assert seldom.trajectories.points[0].shape == (3, N, 3)
    np.testing.assert_allclose(seldom.trajectories.times, [0.0, 10.0 / 240.0, 20.0 / 240.0])


@pytest.mark.full
def test_as_many_are_kept_as_there_is_room_for(monkeypatch: pytest.MonkeyPatch):
    """Trajectories of all frames do not fit here; of each tenth they do, with few beginnings beside."""
    of = scene(frames=20, rate=240.0, substeps=4)
    asked: dict[str, Any] = {"of": PATHS[:1], "loss": at_end, "device": "cpu"}
    told = bw.gradient(of, **asked)
    room = 72 * N * 4
    monkeypatch.setattr(derive, "usable_memory", lambda device: room)
    monkeypatch.setattr("balloon_warp.lab.gradients.derive.usable_memory", lambda device: room)
    with pytest.raises(bw.InputError, match="enough for 4 frames, or 0 worlds; expected fewer, or a loss of"):
        bw.gradient(of, **asked)
    same(bw.gradient(of, every=10, **asked), told)


SECONDS, DEVIATION, JUMP, AT = 0.1, 0.2, 0.05, 0.1
PATH = "balloon.velocity.0"


def flying() -> bw.Scene:
    ball = bw.Balloon(
        mesh=quad_sphere(2, 0.2), mass=0.1, damping=0.0, velocity=(1.0, 0.0, 0.0), inflation=bw.Inflation(pressure=10.0)
    )
    return bw.Scene(balloon=[ball], gravity=0.0, frames=6, substeps=4)


def squared_way(moved: Trajectories) -> tuple[Any, dict[str, Any]]:
    """Return the square of the way, and more beyond a place: of that jump the gradient knows nothing."""
    way, slopes = moved.points[0][:, -1, :, 0].mean(axis=1), np.zeros(moved.points[0].shape)
    slopes[:, -1, :, 0] = 2.0 * way[:, None] / moved.points[0].shape[2]
    return way**2 + JUMP * (way > AT), {"points": [slopes]}


@pytest.mark.full
def test_means_over_samples_are_those_of_a_normal_distribution():
    """Quantiles of 64 samples find the integrals of the loss to 1e-4, of its slope to 2 %: their variance is 1 % less
    than 1, and the jump lies between two of them."""
    speeds = np.array([1.0, 2.0])
    found = bw.gradient(
        flying(), of=[PATH], loss=squared_way, world_count=2, vary={PATH: speeds}, smooth={PATH: DEVIATION}, samples=64,
        device="cpu",
    )  # fmt: skip
    off = [(speed - AT / SECONDS) / DEVIATION for speed in speeds]
    jumps = np.array([JUMP * 0.5 * (1.0 + erf(each / sqrt(2.0))) for each in off])
    densities = np.array([JUMP * exp(-(each**2) / 2.0) / (DEVIATION * sqrt(2.0 * pi)) for each in off])
    smooth_part = 2.0 * SECONDS**2 * speeds
    np.testing.assert_allclose(found.loss, SECONDS**2 * (speeds**2 + DEVIATION**2) + jumps, atol=1e-4)
    np.testing.assert_allclose(found.gradients[PATH], smooth_part, rtol=1e-5)
    np.testing.assert_allclose(found.slopes[PATH], smooth_part + densities, rtol=0.02)
    assert found.errors[PATH] == pytest.approx(2.0 * SECONDS**2 * DEVIATION / 8.0, rel=0.02)
    assert found.by_points[0].shape == (2, 26, 3)
    assert found.trajectories.points[0].shape[0] == 128


def test_one_world_has_no_dimension_for_worlds_and_two_paths_scatter_apart():
    paths = {PATH: DEVIATION, "balloon.mass": 0.01}
    found = bw.gradient(flying(), of=[PATH], loss=squared_way, smooth=paths, samples=8, device="cpu")
    assert (found.loss.shape, found.by_points[0].shape, set(found.slopes)) == ((1,), (26, 3), set(paths))
    ways = found.trajectories.points[0][:, -1, :, 0].mean(axis=1)
    assert len(np.unique(ways.round(6))) == 8
    assert abs(found.slopes["balloon.mass"][0]) < 0.05 / 0.01  # in free flight only chance ties it to the mass


FRAMES, SPHERES = 4, 2


@wp.kernel
def fast_and_high(
    points: wp.array3d[wp.vec3], pressures: wp.array3d[float], sphere_velocities: wp.array3d[wp.vec3d],
    loss: wp.array[wp.float64],
):  # fmt: skip
    world, frame, particle = wp.tid()
    wp.atomic_add(loss, world, wp.float64(wp.length_sq(points[world, frame, particle])))
    if particle == 0:
        wp.atomic_add(loss, world, wp.float64(pressures[world, frame, 0]) * wp.float64(1e-3))
        wp.atomic_add(loss, world, wp.length_sq(sphere_velocities[world, frame, 1]))


def in_numpy(moved: bw.Trajectories) -> tuple[Any, dict[str, Any]]:
    points, speeds = moved.points[0].astype(float), moved.sphere_velocities.astype(float)
    by_speeds = np.zeros(speeds.shape)
    by_speeds[..., 1, :] = 2.0 * speeds[..., 1, :]
    value = (points**2).sum(axis=(-1, -2, -3)) + (speeds[..., 1, :] ** 2).sum(axis=(-1, -2))
    value = value + 1e-3 * moved.pressures[..., 0].sum(axis=-1)
    slopes = {"points": [2.0 * points], "pressures": np.full(moved.pressures.shape, 1e-3)}
    return value, slopes | {"sphere_velocities": by_speeds}


def of_framework(seen: Any) -> Any:
    """Return the same loss, of tensors or arrays of JAX."""
    value = (seen.points[0] ** 2).sum((-1, -2, -3)) + (seen.sphere_velocities[..., 1, :] ** 2).sum((-1, -2))
    return value + 1e-3 * seen.pressures[..., 0].sum(-1)


def moved_at_random(worlds: int) -> bw.Trajectories:
    rng, alone = np.random.default_rng(8), () if worlds == 1 else (worlds,)
    plan = plan_model(scene())

    def track(*shape: int) -> np.ndarray:
        return rng.normal(size=(*alone, FRAMES, *shape)).astype(np.float32)

    return bw.Trajectories(
        plan.scene, [shape.mesh for shape in plan.shapes], np.arange(FRAMES) / 60.0, [track(N, 3)], [track(N, 3)],
        track(1), track(1).astype(float), track(SPHERES, 3), track(SPHERES, 3), np.arange(worlds),
    )  # fmt: skip


def told_of(loss: Any, worlds: int) -> LossDerivatives:
    return evaluate_loss(loss, moved_at_random(worlds), plan_model(scene()).shapes, worlds)


@pytest.mark.full
@pytest.mark.parametrize("worlds", [1, 2])
@pytest.mark.parametrize("kind", ["kernel", "torch", "jax"])
def test_a_loss_is_that_of_numpy(kind: str, worlds: int):
    """Values and derivatives agree to 1e-5: arrays are float32."""
    if kind != "kernel":
        pytest.importorskip(kind)
    loss = {"torch": bw.losses.of_torch, "jax": bw.losses.of_jax, "kernel": lambda _: fast_and_high}[kind](of_framework)
    for ours, theirs in zip(told_of(loss, worlds), told_of(in_numpy, worlds), strict=True):
        np.testing.assert_allclose(ours, theirs, rtol=1e-5, atol=1e-9)


@wp.kernel
def of_ages(ages: wp.array3d[float], loss: wp.array[float]):
    world, frame, number = wp.tid()
    wp.atomic_add(loss, world, ages[world, frame, number])


@wp.kernel(enable_backward=False)
def without_adjoint(volumes: wp.array3d[float], loss: wp.array[float]):
    world, frame, number = wp.tid()
    wp.atomic_add(loss, world, volumes[world, frame, number])


@pytest.mark.parametrize(
    ("kernel", "sentence"),
    [(of_ages, "takes ages, loss; expected loss, an array, and"), (without_adjoint, "no adjoint")],
)
def test_a_kernel_that_is_no_loss_is_refused(kernel: wp.Kernel, sentence: str):
    with pytest.raises(bw.InputError, match=sentence):
        told_of(kernel, 1)


RNG = np.random.default_rng(21)


def require_slope(found: np.ndarray, of: bw.Scene, way: np.ndarray, change: Any) -> None:
    """Require the central difference of the loss along a way, to 1e-4 of the norm of its parts.

    Args:
        change: Function of a balloon of the reference, and of how far its tables are changed."""
    more, less = (
        far_in_float64(of, change=lambda reference, h=h: change(reference.balloons[0], h)) for h in (1e-5, -1e-5)
    )
    assert abs((found * way).sum() - (more - less) / 2e-5) < 1e-4 * np.linalg.norm(found * way)


def remould(balloon: Any, membrane: Membrane, edges: np.ndarray) -> None:
    """Give a balloon's film other edges at rest, with the same thickness."""
    sizes = [np.linalg.norm(np.cross(each[:, 0], each[:, 1]), axis=1) for each in (membrane.edges, edges)]
    other = replace(membrane, edges=edges, areas=membrane.areas * sizes[1] / sizes[0])
    balloon.film = film_of(other, "mooney_rivlin")


@pytest.mark.full
def test_of_each_spring(device: str):
    of = CASES["pressure"].scene
    each = ["rest_lengths", "spring_constants", "rest_points"]
    found = bw.gradient(of, of=SPRINGS, each=each, loss=far, device=device)
    shape = plan_model(of).shapes[0]
    np.testing.assert_array_equal(found.spring_pairs[0], shape.springs.pairs)
    lengths, points = shape.springs.rest_lengths, shape.mesh.points
    longer, stiffer, aside = (RNG.normal(size=size) for size in (lengths.shape, lengths.shape, points.shape))

    def lengthen(balloon: Any, h: float) -> None:
        balloon.springs.lengths = (lengths * (1.0 + h * longer))[:, None]

    def stiffen(balloon: Any, h: float) -> None:
        balloon.springs.constants = balloon.springs.constants + 10.0 * h * stiffer[:, None]

    def reshape(balloon: Any, h: float) -> None:
        balloon.springs.lengths = shape.springs.resting_at(points + 0.1 * h * aside).rest_lengths[:, None]

    require_slope(found.by_each["rest_lengths"][0], of, lengths * longer, lengthen)
    require_slope(found.by_each["spring_constants"][0], of, 10.0 * stiffer, stiffen)
    require_slope(found.by_each["rest_points"][0], of, 0.1 * aside, reshape)
    kinds = np.bincount(shape.springs.kind, found.by_each["spring_constants"][0])
    assert kinds == pytest.approx([found.gradients[path][0] for path in SPRINGS], rel=1e-5)


@pytest.mark.full
def test_of_each_face(tmp_path: Path, device: str):
    """Gradients of a ball that is stretched everywhere from the start, so that no triangle is at the law's kink."""
    write_obj(tmp_path / "small.obj", replace(BALL, points=0.9 * BALL.points))
    of = scene(frames=6, material={"kind": "mooney_rivlin", "rest_mesh": tmp_path / "small.obj"})
    found = bw.gradient(of, each=["thicknesses", "rest_points"], loss=far, device=device).by_each
    membrane = plan_model(of).shapes[0].membrane
    thicker, aside = 1e-4 * RNG.normal(size=BALL.face_count), 0.1 * RNG.normal(size=BALL.points.shape)

    def thicken(balloon: Any, h: float) -> None:
        balloon.film.areas = membrane.areas * (1.0 + h * thicker[membrane.faces] / THICKNESS.default)

    def reshape(balloon: Any, h: float) -> None:
        corners = (0.9 * BALL.points + h * aside)[membrane.corners]
        remould(balloon, membrane, corners[:, 1:] - corners[:, :1])

    require_slope(found["thicknesses"][0], of, thicker, thicken)
    require_slope(found["rest_points"][0], of, aside, reshape)


@pytest.mark.full
def test_of_panels_before_they_are_sewn(tmp_path: Path, device: str):
    points = 0.9 * BALL.points[BALL.face_vertex_indices]
    panels = replace(BALL, points=points, face_vertex_indices=np.arange(len(points), dtype=np.int32))
    write_obj(tmp_path / "panels.obj", panels)
    of = scene(frames=2, material={"kind": "mooney_rivlin", "rest_mesh": tmp_path / "panels.obj"})
    (found,) = bw.gradient(of, each=["rest_points"], loss=far, device=device).by_each["rest_points"]
    way = 0.1 * RNG.normal(size=points.shape)

    def recut(balloon: Any, h: float) -> None:
        corners = (points + h * way)[build_membrane(panels).corners]
        remould(balloon, plan_model(of).shapes[0].membrane, corners[:, 1:] - corners[:, :1])

    require_slope(found, of, way, recut)


@pytest.mark.full
def test_a_world_in_a_batch_has_the_derivatives_that_it_has_alone(device: str):
    of, each = CASES["pressure"].scene, ["rest_lengths", "spring_constants"]
    masses = np.array([0.05, 0.07])
    found = bw.gradient(of, each=each, loss=far, world_count=2, vary={"balloon.mass": masses}, device=device)
    alone = bw.gradient(of, each=each, loss=far, vary={"balloon.mass": masses[1:]}, device=device)
    for name in each:
        np.testing.assert_array_equal(found.by_each[name][0][1], alone.by_each[name][0])
        assert not np.array_equal(*found.by_each[name][0])
