"""Parts of the ray caster, each against its definition."""
# pyright: reportIndexIssue=false

import numpy as np
import pytest
import warp as wp
from meshes import quad_sphere

from balloon_warp.kernels import OPTIONS
from balloon_warp.kernels.pictures.surfaces import Hit, Shapes, capsule_distance, sky_share, srgb_byte, tone
from balloon_warp.mesh.orientation import CREASE
from balloon_warp.mesh.polygon_mesh import PolygonMesh
from balloon_warp.studio.render.surface import TILE, SmoothSurface, disc_points
from balloon_warp.usd.studio import MARGIN, CameraFit

wp.set_module_options(OPTIONS)


@wp.kernel
def measure_capsules(
    origins: wp.array[wp.vec3],
    directions: wp.array[wp.vec3],
    begins: wp.array[wp.vec3],
    ends: wp.array[wp.vec3],
    radii: wp.array[float],
    distances: wp.array[float],
):
    ray = wp.tid()
    distances[ray] = capsule_distance(origins[ray], directions[ray], begins[ray], ends[ray], radii[ray])


@wp.kernel
def develop_gray(light: wp.array[float], out: wp.array[wp.uint8]):
    step = wp.tid()
    out[step] = srgb_byte(tone(wp.vec3(light[step]))[1])


def test_rays_meet_capsules_where_marching_finds_them():
    random = np.random.default_rng(7)
    count = 400
    begins = random.uniform(-1, 1, (count, 3))
    ends = begins + random.normal(0, 0.5, (count, 3))
    ends[::5] = begins[::5]  # spheres
    radii = random.uniform(0.02, 0.5, count)
    origins = random.normal(0, 1, (count, 3))
    origins *= 6.0 / np.linalg.norm(origins, axis=1, keepdims=True)
    directions = 0.5 * (begins + ends) + random.normal(0, 0.3, (count, 3)) - origins
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    directions[1::5] = (ends - begins)[1::5] / np.linalg.norm((ends - begins)[1::5], axis=1, keepdims=True)
    origins[1::5] = begins[1::5] - 5.0 * directions[1::5]  # straight along the axis

    def outside(points):
        axis = ends - begins
        along = np.einsum("ij,ij->i", points - begins, axis) / np.maximum(np.einsum("ij,ij->i", axis, axis), 1e-30)
        return np.linalg.norm(points - begins - np.clip(along, 0, 1)[:, None] * axis, axis=1) - radii

    marched = np.zeros(count)
    for _ in range(3000):
        marched += np.where(marched < 20.0, outside(origins + marched[:, None] * directions), 0.0)
    distances = wp.zeros(count, dtype=float, device="cpu")
    vectors = [wp.array(each, dtype=wp.vec3, device="cpu") for each in (origins, directions, begins, ends)]
    measured = [*vectors, wp.array(radii, dtype=float, device="cpu"), distances]
    wp.launch(measure_capsules, count, inputs=measured, device="cpu")
    hit = marched < 20.0
    # Rays that pass within a hair of the outline may go either way; there are none among these.
    assert 0.3 < hit.mean() < 0.95
    assert (distances.numpy()[~hit] == -1.0).all()
    # float32 from 6 units away, and worse where the ray grazes.
    assert distances.numpy()[hit] == pytest.approx(marched[hit], abs=2e-3)


def test_a_thin_line_is_met_from_afar():
    """A line of one part in 20,000 is hit: the radius squared is far below the round-off of the distance squared."""
    offsets = np.linspace(-1.8e-3, 1.8e-3, 37)
    count = len(offsets)
    origins = np.stack([np.full(count, 0.013), offsets, np.full(count, 20.0)], axis=1)
    rows = [origins, *(np.tile(each, (count, 1)) for each in ([0.0, 0.0, -1.0], [-1.0, 0.0, 0.0], [1.0, 0.0, 0.0]))]
    distances = wp.zeros(count, dtype=float, device="cpu")
    vectors = [wp.array(each, dtype=wp.vec3, device="cpu") for each in rows]
    radii = wp.full(count, 1e-3, dtype=float, device="cpu")
    wp.launch(measure_capsules, count, inputs=[*vectors, radii, distances], device="cpu")
    clear = np.abs(np.abs(offsets) - 1e-3) > 5e-5
    assert ((distances.numpy() > 0.0) == (np.abs(offsets) < 1e-3))[clear].all()


def test_tones_are_neutral_and_end_in_white():
    light = np.array([0.0, 0.02, 0.18, 0.5, 0.8, 2.0, 50.0], np.float32)
    out = wp.zeros(len(light), dtype=wp.uint8, device="cpu")
    wp.launch(develop_gray, len(light), inputs=[wp.array(light, device="cpu"), out], device="cpu")
    # Khronos PBR Neutral takes 0.04 off, or less of darker colors, and compresses above 0.76; then sRGB's power law.
    linear = np.array([0.0, 6.25 * 0.02**2, 0.14, 0.46, 0.76, 1 - 0.0576 / 1.44, 1.0])
    encoded = np.where(linear > 0.0031308, 1.055 * linear ** (1 / 2.4) - 0.055, 12.92 * linear)
    assert out.numpy().astype(int) == pytest.approx(255 * encoded, abs=1.0)


@pytest.mark.parametrize("angles", [(), (200.0, 0.0), (-90.0, 90.0)])
@pytest.mark.parametrize("aspect", [16 / 9, 0.5])
def test_the_camera_is_as_near_as_the_margin_lets_it(aspect: float, angles: tuple[float, ...]):
    random = np.random.default_rng(3)
    centers, radii = random.uniform(-3, 5, (30, 3)), random.uniform(0.0, 1.0, 30)
    fit = CameraFit(aspect, *angles)
    fit.include(centers[:10], radii[:10])
    fit.include(centers[10:], radii[10:])
    camera = fit.camera()
    around = random.normal(size=(20_000, 3))
    around /= np.linalg.norm(around, axis=1, keepdims=True)
    points = (centers[:, None] + radii[:, None, None] * around).reshape(-1, 3)
    seen = (points - camera.eye) @ camera.axes.T
    assert (seen[:, 2] < 0.0).all()
    across = seen[:, 0] / -seen[:, 2] / camera.half_width
    up = seen[:, 1] / -seen[:, 2] / camera.half_height
    edges = np.array([across.min(), across.max(), up.min(), up.max()])
    # Nothing beyond the margin, and in one of the two directions both sides touch it; 1%: the spheres are sampled.
    assert (np.abs(edges) <= MARGIN + 1e-9).all()
    assert max(np.abs(edges[:2]).min(), np.abs(edges[2:]).min()) == pytest.approx(MARGIN, rel=0.01)
    assert np.linalg.det(camera.axes) == pytest.approx(1.0)


def test_refining_a_sphere_keeps_its_vertices_and_comes_closer_to_round():
    ball = quad_sphere(4)
    surface, points = SmoothSurface(ball), ball.points
    refined, normals = surface.place(points)
    assert len(surface.triangles) == 6 * 16 * 2 * 4**2
    assert surface.triangles.max() == len(refined) - 1
    assert (refined[: len(points)] == points).all()
    assert np.linalg.norm(normals, axis=1) == pytest.approx(1.0)
    # A chord of the coarse sphere dips by 1 - cos(pi / 16) = 2% of the radius, twice that across a quad; the curves
    # through the vertices, which are only as good as the normals, by less than a quarter of that.
    assert np.abs(np.linalg.norm(refined, axis=1) - 1.0).max() < 0.01
    assert np.einsum("ij,ij->i", refined, normals).min() > 0.98


def test_disc_samples_of_a_tile_are_spread_evenly():
    points = disc_points(4).reshape(-1, 2)
    assert len(points) == 4 * TILE * TILE
    assert (np.linalg.norm(points, axis=1) <= 1.0).all()
    # Uniform in area: mean at the middle, mean squared distance 1/2. 64 random points would be off by 0.06 and 0.04.
    assert points.mean(axis=0) == pytest.approx([0.0, 0.0], abs=0.03)
    assert (points**2).sum(axis=1).mean() == pytest.approx(0.5, abs=0.02)


def test_a_cube_stays_a_cube():
    surface = SmoothSurface(quad_sphere(1, np.sqrt(3.0)), CREASE)  # whose corners are at 1
    points, normals = surface.place(quad_sphere(1, np.sqrt(3.0)).points)
    # Four vertices a side; then the sides' 5, and then their 16 edges' and triangles' middles: a 5 x 5 grid.
    assert len(points) == surface.vertex_count == 6 * 25
    assert np.abs(normals).max(axis=1) == pytest.approx(1.0)
    assert np.einsum("ij,ij->i", points, normals) == pytest.approx(1.0)
    assert np.abs(points).max() == pytest.approx(1.0)


def test_a_crease_between_a_round_and_a_flat_side_has_no_gap():
    sides = 12  # 30 degrees from one to the next, which is smooth; 90 to the lids
    angle = 2 * np.pi * np.arange(sides) / sides
    ring = np.stack([np.cos(angle), np.zeros(sides), -np.sin(angle)], axis=1)
    points = np.concatenate([ring - [0, 1, 0], ring + [0, 1, 0]])
    here = np.arange(sides)
    after = (here + 1) % sides
    walls = np.stack([here, after, after + sides, here + sides], axis=1).ravel()
    indices = np.concatenate([walls, here[::-1], here + sides]).astype(np.int32)
    can = PolygonMesh(points, np.array([4] * sides + [sides] * 2, np.int32), indices)
    surface = SmoothSurface(can, CREASE)
    placed, normals = surface.place(points)
    round_side = np.abs(normals[:, 1]) < 0.5
    assert np.abs(normals[round_side, 1]).max() < 1e-12
    assert np.abs(normals[~round_side, 1]) == pytest.approx(1.0)
    # Each side of an edge has the mirror image in the other: no edge of a triangle is alone in its place.
    _, place = np.unique(placed.round(9), axis=0, return_inverse=True)
    ends = np.sort(place.ravel()[surface.triangles[:, [[0, 1], [1, 2], [2, 0]]]].reshape(-1, 2), axis=1)
    assert set(np.unique(ends, axis=0, return_counts=True)[1]) == {2}
    # Halfway up, where nothing is sharp, the wall is as round as ever: its chords would dip to 0.966.
    middle = np.abs(placed[:, 1]) < 0.01
    assert np.linalg.norm(placed[middle], axis=1).min() > 0.985


@wp.kernel
def measure_sky(distances: wp.array[float], ground_color: wp.vec3, shares: wp.array[wp.vec3]):
    place = wp.tid()
    shapes = Shapes()
    shapes.has_ground = 1
    shapes.ground_color = ground_color
    hit = Hit()
    hit.point = wp.vec3(0.0, distances[place], 0.0)
    hit.normal = wp.vec3(0.0, -1.0, 0.0)
    shares[place] = sky_share(shapes, hit, wp.vec2(0.0, 0.0))


def test_what_is_near_dims_the_sky_more_than_what_is_far():
    distances = np.array([0.01, 0.1, 0.35, 0.6, 0.69, 0.75, 5.0])
    color = np.array([0.2, 0.5, 0.9])
    shares = wp.zeros(len(distances), dtype=wp.vec3, device="cpu")
    given = [wp.array(distances, dtype=float, device="cpu"), wp.vec3(*color.tolist()), shares]
    wp.launch(measure_sky, len(distances), inputs=given, device="cpu")
    # Straight down onto the ground: 0.35 of its color where it is touched, all of the sky from 0.7 away.
    far = np.minimum(distances / 0.7, 1.0)[:, None]
    # 2e-3: rays start 1e-3 off the surface, which is 1e-3 / 0.7 of the way.
    assert shares.numpy() == pytest.approx(0.35 * color * (1.0 - far) + far, abs=2e-3)
