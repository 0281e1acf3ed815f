"""Searches of contact against all pairs: bounds that leave things out, and lists of what is near."""
# pyright: reportGeneralTypeIssues=false

from itertools import pairwise

import numpy as np
import pytest
import warp as wp
from feature_sets import feature_set
from scipy.spatial.transform import Rotation
from touching import tube

from balloon_warp import Balloon, PolygonMesh, Scene, Simulator, Touch
from balloon_warp.kernels import OPTIONS
from balloon_warp.kernels.contact.boxes import SPARE, box_balloons, box_parts_of_worlds, lining_function
from balloon_warp.kernels.contact.free_frames import OwnParts, least_between, place_part
from balloon_warp.kernels.contact.search import neighbor_function, next_of_eight
from balloon_warp.kernels.contact.triangles import near_parts_kernel
from balloon_warp.kernels.laws.contact import NEAR_BODY, NEVER
from balloon_warp.kernels.laws.touch import facing_of, part_until_contact
from balloon_warp.kernels.loops.contact import A_STEP, solid_function
from balloon_warp.kernels.tables import Tables, WorldState
from balloon_warp.kernels.working import Working
from balloon_warp.lab.reference.contact import point_triangle
from balloon_warp.model import build_model
from balloon_warp.model.state import Allocating
from balloon_warp.model.touch import APART, edge_length
from balloon_warp.schedules.outlook import own_parts, own_parts_arrays
from balloon_warp.schedules.tables import world_state
from balloon_warp.system.warp_threads import launch, launch_tiled


@wp.kernel(enable_backward=False)
def place_all(own: OwnParts, points: wp.array2d[wp.vec3], before: wp.array2d[wp.vec3], drift: wp.vec3):
    part = wp.tid()
    place_part(own, 0, part, points, before, drift)


@wp.kernel(enable_backward=False)
def bound_all(own: OwnParts, found: wp.array2d[float]):
    one = wp.tid()
    for other in range(found.shape[1]):
        found[one, other] = least_between(own, 0, one, other)


def bent(mesh: PolygonMesh, radius: float) -> np.ndarray:
    """Return the points of a tube along x, bent to an arc, turned, moved and larger."""
    x, y, z = mesh.points.T
    arc = np.stack([(radius - y) * np.sin(x / radius), radius - (radius - y) * np.cos(x / radius), z], axis=1)
    return 1.2 * Rotation.from_euler("xyz", [20.0, 40.0, 70.0], degrees=True).apply(arc) + 3.0


@pytest.mark.parametrize("radius", [1e6, 4.0, 1.0])
def test_no_two_parts_of_a_balloon_are_nearer_than_their_bound(radius: float):
    """The bound is for all particles that may touch, far apart at the start; where nothing bends it says much."""
    mesh = tube(17, 12)
    model = build_model(Scene(balloon=[Balloon(mesh=mesh)], touch=Touch(itself=True)), "cpu")
    own, points = own_parts(model), bent(mesh, radius)
    for name, array in own_parts_arrays(model, Allocating(model.device)).items():
        setattr(own, name, array)
    count = len(own.balloons)
    found = wp.zeros((count, count), dtype=float, device="cpu")
    before, drift = points + np.random.default_rng(2).uniform(-0.3, 0.3, points.shape), np.array([0.2, 0.1, -0.3])
    given = [wp.array(each[None], dtype=wp.vec3, device="cpu") for each in (points, points, before)]
    wp.launch(place_all, count, [own, given[0], given[2], wp.vec3(*drift)], device="cpu")
    first, particles = own.first.numpy(), own.particles.numpy()
    parts = [particles[begin:end] for begin, end in pairwise(first)]
    both = np.stack([points, before + drift])
    around = [(both[:, part].min(axis=(0, 1)), both[:, part].max(axis=(0, 1))) for part in parts]
    np.testing.assert_allclose(own.boxes.numpy()[0], around, atol=1e-6)
    wp.launch(place_all, count, [own, *given[:2], wp.vec3()], device="cpu")
    wp.launch(bound_all, count, [own, found], device="cpu")
    rest, now = (np.linalg.norm(each[:, None] - each, axis=-1) for each in (mesh.points, points))
    now[rest < APART * edge_length(mesh)] = np.inf
    gaps = np.array([[now[np.ix_(one, other)].min() for other in parts] for one in parts])
    assert (found.numpy() <= gaps + 1e-6).all()
    far = np.isfinite(gaps) & (gaps > 0.5)
    assert radius < 1e6 or (found.numpy()[far] > 0.3 * gaps[far]).all()


def test_no_particle_that_may_meet_a_sphere_is_left_out_early():
    """The early test looks at twice a particle's way, as does `comes_near`."""
    simulator = Simulator(feature_set("spheres"), "cpu", schedule="gather")
    solid_at = solid_function(simulator.schedule.features)

    @wp.kernel(module="unique", enable_backward=False, module_options=OPTIONS)
    def reach_all(t: Tables, state: WorldState, found: wp.array[float]):  # pyright: ignore[reportGeneralTypeIssues]
        solid = wp.tid()
        _center, _motion, reach = solid_at(t, state, 0, solid, 0.0)
        found[solid] = reach

    radii = np.array([sphere.radius for sphere in feature_set("spheres").sphere])
    found = wp.zeros(len(radii), dtype=float, device="cpu")
    wp.launch(reach_all, len(radii), [simulator.schedule.tables, world_state(simulator.state), found], device="cpu")
    rng = np.random.default_rng(4)
    for radius, reach in zip(radii, found.numpy(), strict=True):
        distances, lengths = radius * rng.uniform(0.9, 2.0, 20_000), radius * rng.uniform(0.0, 0.5, 20_000)
        towards = rng.normal(size=(20_000, 3)) * 0.1 - (1.0, 0.0, 0.0)
        way = (lengths / np.linalg.norm(towards, axis=1))[:, None] * towards
        end = distances[:, None] * (1.0, 0.0, 0.0)
        part = np.clip(-(end * way).sum(axis=1) / np.maximum((way**2).sum(axis=1), 1e-12), -1.0, 1.0)
        comes = np.linalg.norm(end + part[:, None] * way, axis=1) < float(NEAR_BODY) * radius
        looks = distances**2 < reach + float(A_STEP) * lengths**2
        assert looks[comes].all()
        assert looks.mean() < 0.9


def test_boxes_hold_what_particles_sweep_until_the_next_search():
    """Boxes have where particles are and will be by their speeds, and how far they have come since the last search."""
    simulator = Simulator(feature_set("touch"), "cpu", schedule="gather")
    simulator.step_unread()
    t, working, state = simulator.schedule.tables, simulator.schedule.launches.working, simulator.state
    dim = (1, simulator.model.balloon_count)
    launch_tiled(
        box_balloons, dim, [t, state.points, state.velocities, 0, working], block_dim=1, device=simulator.model.device
    )
    points, sought = state.points.numpy()[0], working.sought.numpy()[0]
    way = t.touch.seconds * state.velocities.numpy()[0]
    both, speed = np.stack([points, points + way]), np.linalg.norm(way, axis=1) / t.touch.seconds
    moved = np.linalg.norm(points - sought, axis=1)
    straying, slack = moved + t.touch.seconds * speed, t.touch.slack.numpy()
    for balloon, (begin, end) in enumerate(pairwise(simulator.model.particle_offsets)):
        lower, upper, pace = working.balloon_boxes.numpy()[0, balloon]
        np.testing.assert_allclose(lower, both[:, begin:end].min(axis=(0, 1)), atol=1e-6)
        np.testing.assert_allclose(upper, both[:, begin:end].max(axis=(0, 1)), atol=1e-6)
        strayed = straying[begin:end].max() > float(SPARE) * slack[balloon]
        np.testing.assert_allclose(
            pace, [speed[begin:end].max(), strayed, moved[begin:end].max()], rtol=1e-5, atol=1e-6
        )


def test_a_particle_looks_at_the_balloons_whose_boxes_its_way_meets():
    """Boxes are compared one by one as on a GPU, and eight at a time as on a CPU, by ways beyond their padding."""
    simulator = Simulator(feature_set("touch"), "cpu", schedule="gather")
    simulator.step_unread()
    t, working, features = simulator.schedule.tables, simulator.schedule.launches.working, simulator.schedule.features
    next_neighbor, line_up = neighbor_function(features), lining_function(features)
    count, balloons = simulator.model.particle_count, simulator.model.balloon_count

    @wp.kernel(module="unique", enable_backward=False, module_options=OPTIONS)
    def look_around(
        t: Tables,  # pyright: ignore[reportGeneralTypeIssues]
        working: Working,  # pyright: ignore[reportGeneralTypeIssues]
        points: wp.array2d[wp.vec3],
        velocities: wp.array2d[wp.vec3],
        found: wp.array3d[wp.int32],
    ):
        for particle in range(points.shape[1]):
            balloon = t.particles.balloon[particle]
            point = points[0, particle]
            velocity = velocities[0, particle]
            line_up(t, working, 0, particle, particle - 1)
            for way in range(2):
                place = wp.int32(0)
                other = wp.int32(0)
                while other >= 0:
                    if way == 0:
                        other, place = next_neighbor(t, working, 0, balloon, place, point, velocity)
                    else:
                        other, place = next_of_eight(t, working, 0, balloon, place, point, velocity)
                    if other >= 0:
                        found[way, particle, other] = found[way, particle, other] + 1

    working.neighbors.assign(np.tile(np.arange(balloons), (1, balloons, 1)))
    working.neighbor_counts.fill_(balloons)
    velocities = 80.0 * np.random.default_rng(3).uniform(-1.0, 1.0, (1, count, 3))
    found = wp.zeros((2, count, balloons), dtype=wp.int32, device="cpu")
    given = wp.array(velocities, dtype=wp.vec3, device="cpu")
    wp.launch(look_around, 1, [t, working, simulator.state.points, given, found], device="cpu")
    start, own = simulator.state.points.numpy()[0], t.particles.balloon.numpy()
    ends = np.stack([start, start + t.touch.seconds * velocities[0]])
    boxes, pads = working.balloon_boxes.numpy()[0], 0.5 * t.touch.thickness.numpy() + t.touch.slack.numpy()
    apart = np.maximum(ends.min(axis=0)[:, None] - boxes[:, 1], boxes[:, 0] - ends.max(axis=0)[:, None]).max(axis=2)
    expected = apart <= pads[own][:, None] + pads
    np.testing.assert_array_equal(found.numpy(), np.broadcast_to(expected, found.shape))
    assert 0.1 < expected.mean() < 0.6


@wp.kernel(enable_backward=False)
def meet_all(
    starts: wp.array[wp.mat33], ends: wp.array[wp.mat33], centers: wp.array2d[wp.vec3], radii: wp.array[float],
    found: wp.array[float],
):  # fmt: skip
    i = wp.tid()
    facing = facing_of(centers[0, i], centers[1, i], radii[i], starts[i], ends[i])
    part, _looks = part_until_contact(facing, radii[i])
    found[i] = part


def test_a_sphere_that_comes_through_a_triangle_is_met_before_half_its_radius():
    """A sphere is met nearer than its radius, and never by half of that, as steps go no further than by half of the
    distance; judged by 4,000 looks on the way."""
    rng, count = np.random.default_rng(6), 400
    starts = rng.normal(size=(count, 3, 3))
    ends, centers = starts + rng.normal(size=starts.shape), 1.5 * rng.normal(size=(2, count, 3))
    radii = rng.uniform(0.1, 0.4, count)
    found = wp.zeros(count, dtype=float, device="cpu")
    of_types = ((starts, wp.mat33), (ends, wp.mat33), (centers, wp.vec3), (radii, float))
    given = [wp.array(values, dtype=kind, device="cpu") for values, kind in of_types]
    wp.launch(meet_all, count, [*given, found], device="cpu")
    parts = np.linspace(0.0, 1.0, 4001)[:, None, None]

    def distance(part: np.ndarray) -> np.ndarray:
        corners, center = starts + part[..., None] * (ends - starts), centers[0] + part * (centers[1] - centers[0])
        at = np.concatenate([center[..., None, :], corners], axis=-2).reshape(-1, 4, 3)
        return np.linalg.norm((point_triangle(at) * at).sum(axis=1), axis=1).reshape(-1, count)

    away, told = distance(parts) / radii, found.numpy()
    outside, met = away[0] > 1.0, told <= 1.0
    near = distance(told[None, :, None])[0] / radii
    assert met[outside & (away < 0.5).any(axis=0)].all()
    assert (near[outside & met] > 0.5 - 1e-4).all()
    assert (near[met] < 1.0 + 1e-4).all()
    np.testing.assert_array_equal(told[(away > 1.0).all(axis=0)], float(NEVER))
    assert min((outside & met).sum(), (~met).sum()) > 50


def test_parts_list_those_whose_boxes_meet_theirs():
    """Each part's box holds its triangles' sweeps; leaves of balloons too fast for clearances list those near them."""
    simulator = Simulator(feature_set("touch"), "cpu", schedule="gather")
    simulator.step_unread()
    t, working, state = simulator.schedule.tables, simulator.schedule.launches.working, simulator.state
    device, kernel = simulator.model.device, near_parts_kernel(simulator.schedule.features)
    launch_tiled(box_parts_of_worlds, [1], [t, state.points, state.velocities, working], block_dim=1, device=device)
    working.near_part_counts.zero_()
    launch(kernel, (1, 2), [t, 2, working], device=device)
    points, parts, triangles = state.points.numpy()[0], t.touch.parts.numpy(), t.touch.triangles.numpy()
    both = np.stack([points, points + t.touch.seconds * state.velocities.numpy()[0]])
    boxes = working.part_boxes.numpy()[0].reshape(-1, 2, 4)[..., :3]
    for (_after, begin, end, _balloon), (lower, upper) in zip(parts, boxes, strict=True):
        swept = both[:, triangles[begin:end].ravel()]
        np.testing.assert_allclose(lower, swept.min(axis=(0, 1)), atol=1e-6)
        np.testing.assert_allclose(upper, swept.max(axis=(0, 1)), atol=1e-6)
    leaves = np.flatnonzero(parts[:, 0] == np.arange(len(parts)) + 1)
    counts, listed = working.near_part_counts.numpy()[0], working.near_parts.numpy()[0]
    searched = leaves[counts[leaves] >= 0]
    assert set(parts[searched, 3]) == {len(simulator.model.shapes) - 1}
    for leaf in searched:
        balloon = parts[leaf, 3]
        pad = float(t.touch.thickness.numpy()[balloon] + 2.0 * t.touch.slack.numpy()[balloon])
        apart = np.maximum(boxes[leaf, 0] - boxes[:, 1], boxes[:, 0] - boxes[leaf, 1]).max(axis=1)
        near = [other for other in leaves if parts[other, 3] == balloon and apart[other] <= pad]
        assert sorted(listed[leaf, : counts[leaf]]) == near
    assert 1 < counts[searched].min() < counts[searched].max() < len(leaves)


def test_balloons_that_part_have_no_lists():
    simulator = Simulator(feature_set("all"), "cpu", schedule="gather")
    working, first = simulator.schedule.launches.working, simulator.model.particle_offsets
    simulator.step_unread()
    assert working.candidate_counts.numpy().any()
    points = simulator.state.points.numpy()
    for number, (begin, end) in enumerate(pairwise(first)):
        points[:, begin:end, 2] += 20.0 * number
    simulator.state.points.assign(points)
    simulator.step_unread()
    assert not working.candidate_counts.numpy().any()
    assert not working.list_lengths.numpy().any()
