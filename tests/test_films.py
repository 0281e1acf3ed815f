"""Faces of membranes as blocks go through them, where they hand out area vectors, too: on a GPU alone otherwise."""

from dataclasses import replace

import numpy as np
import pytest
import warp as wp
from meshes import cube, grid, mesh_of, prism, quad_sphere

from balloon_warp.kernels.loops.springs import spring_loop
from balloon_warp.kernels.memory import in_tile, put_in_tile
from balloon_warp.kernels.options import OPTIONS
from balloon_warp.kernels.own import numbers_reader, own_functions
from balloon_warp.kernels.schedules.block_ends import stretch_function
from balloon_warp.kernels.schedules.block_films import films_of
from balloon_warp.kernels.schedules.block_memory import Layout, Seat, no_springs
from balloon_warp.kernels.tables import Tables
from balloon_warp.mesh import PolygonMesh
from balloon_warp.mesh.geometry import signed_volume
from balloon_warp.model import build_model
from balloon_warp.scene import Balloon, Inflation, Material, Scene
from balloon_warp.scene.schema.material import Kind
from balloon_warp.schedules.films import (
    film_entries,
    film_layout,
    film_order,
    film_table,
    held_layout,
    shapes_of,
    sums_of,
)
from balloon_warp.schedules.membranes import membrane_quads
from balloon_warp.schedules.pairs import paired
from balloon_warp.schedules.renumber import renumbered
from balloon_warp.schedules.tables import make_tables
from balloon_warp.schedules.traits import model_traits

QUADS = quad_sphere(3, 0.1)
TRIANGLES = mesh_of(QUADS.points.tolist(), [c for a, b, d, e in QUADS.face_vertex_indices.reshape(-1, 4).tolist()
                                            for c in ([a, b, d], [a, d, e])])  # fmt: skip


def measured(
    mesh: PolygonMesh, points: np.ndarray, held: int, kind: Kind = "mooney_rivlin"
) -> tuple[np.ndarray, np.ndarray]:
    """What faces pull particles with [N], and their area vectors [m^2].

    Args:
        held: of how many quads each thread keeps what it knows, 2 of a pair.
    """
    gas, material = Inflation(kind="gas", start_pressure=0.0), Material(preset="latex", kind=kind)
    model = build_model(Scene(balloon=[Balloon(mesh=mesh, material=material, inflation=gas)]), "cpu")
    traits = model_traits(model)
    film = film_layout(model, traits)
    assert film is not None
    assert film.areas
    count, threads = model.particle_count, model.face_count // held if held else 1
    film = held_layout(model, film, held * threads, threads)
    assert film.pairs == (threads if held == 2 else 0)
    places = film_entries(model, film)
    tables = make_tables(model, traits, in_block=True)
    tables.membranes.films = film_table(model, film, resident=True)
    layout = Layout(threads, count, resident=True, faces=places, film=film)
    films = films_of(traits, layout, wp.int32, no_springs, spring_loop(traits, in_tile))
    read_numbers = numbers_reader(traits.columns)
    _, read_own = own_functions(traits.columns, traits.balloons)

    @wp.kernel(module="unique", enable_backward=False, module_options=OPTIONS)
    def measure(
        t: Tables,  # pyright: ignore[reportGeneralTypeIssues] - a struct
        points: wp.array[wp.vec3],
        pulled: wp.array[wp.vec3],
        found: wp.array[wp.vec3],
    ):
        tile = wp.tile_empty(shape=count, dtype=wp.vec3, storage="shared")
        pulls = wp.tile_full(shape=places, dtype=wp.vec4, value=wp.vec4(1.0), storage="shared")
        areas = wp.tile_full(shape=places, dtype=wp.vec2, value=wp.vec2(1.0), storage="shared")
        for particle in range(count):
            put_in_tile(tile, particle, points[particle])
        seat = Seat()
        seat.count = count
        films.begin(t, seat, pulls, areas)
        for thread in range(threads):
            seat.thread = thread
            first = films.read(t, 0, read_own(t, 0, 0), thread, True)
            films.stretch(t, seat, read_numbers(t, 0, 0), first, tile, points, pulls, areas)
        for particle in range(count):
            mine = films.read(t, 0, read_own(t, 0, particle), particle, True)
            taken = films.take(t, seat, particle, mine, pulls, areas)
            pulled[particle] = taken.pull
            found[particle] = taken.area_vector

    pulled, found = (wp.zeros(count, dtype=wp.vec3, device="cpu") for _ in range(2))
    given = [tables, wp.array(points, dtype=wp.vec3, device="cpu"), pulled, found]
    wp.launch_tiled(measure, dim=[1], inputs=given, block_dim=1, device="cpu")
    return pulled.numpy(), found.numpy()


def measured_at_ends(mesh: PolygonMesh, points: np.ndarray, kind: Kind) -> tuple[np.ndarray, np.ndarray]:
    """The same where threads have the particles at the ends of the edges that their pairs share."""
    gas, material = Inflation(kind="gas", start_pressure=0.0), Material(preset="latex", kind=kind)
    model = build_model(Scene(balloon=[Balloon(mesh=mesh, material=material, inflation=gas)]), "cpu")
    traits = model_traits(model)
    film, count, threads, room = film_layout(model, traits), model.particle_count, 32, 64
    assert film is not None
    film = held_layout(model, film, room, threads, renumbered=True)
    assert film.own_slots == 2
    order, places = film_order(model, film), film_entries(model, film)
    tables = make_tables(renumbered(model, order), traits, in_block=True)
    tables.membranes.films = film_table(model, film, resident=True)
    layout = Layout(threads, room, resident=True, two=True, faces=places, film=film)
    films = films_of(traits, layout, wp.int32, no_springs, spring_loop(traits, in_tile))
    Own, read_own = own_functions(traits.columns, traits.balloons)  # noqa: N806 - a type

    @wp.struct
    class Member:
        own: Own  # pyright: ignore[reportGeneralTypeIssues] - a struct
        springs: films.held  # pyright: ignore[reportInvalidTypeForm]
        point: wp.vec3
        active: bool

    stretch = stretch_function(traits, layout, films, Member)

    @wp.func
    def seated(
        t: Tables,  # pyright: ignore[reportGeneralTypeIssues] - a struct
        points: wp.array[wp.vec3],
        place: wp.int32,
    ):
        member = Member()
        member.active = place < count
        member.own = read_own(t, 0, wp.min(place, count - 1))
        member.springs = films.read(t, 0, member.own, place, member.active)
        member.point = points[wp.min(place, count - 1)]
        return member

    @wp.kernel(module="unique", enable_backward=False, module_options=OPTIONS)
    def measure(
        t: Tables,  # pyright: ignore[reportGeneralTypeIssues] - a struct
        points: wp.array[wp.vec3],
        pulled: wp.array[wp.vec3],
        found: wp.array[wp.vec3],
    ):
        tile = wp.tile_empty(shape=room, dtype=wp.vec3, storage="shared")
        pulls = wp.tile_full(shape=places, dtype=wp.vec4, value=wp.vec4(1.0), storage="shared")
        areas = wp.tile_full(shape=places, dtype=wp.vec2, value=wp.vec2(1.0), storage="shared")
        for place in range(count):
            put_in_tile(tile, place, points[place])
        seat = Seat()
        films.begin(t, seat, pulls, areas)
        for turn in range(room):  # in the second round all find what others did
            seat.thread = turn % threads
            mine = seated(t, points, seat.thread)
            also = seated(t, points, seat.thread + threads)
            first, second = stretch(t, seat, mine, also, tile, points, pulls, areas)
            pulled[seat.thread] = first.springs.pull
            pulled[seat.thread + threads] = second.springs.pull
            found[seat.thread] = first.springs.area_vector
            found[seat.thread + threads] = second.springs.area_vector

    pulled, found = (wp.zeros(room, dtype=wp.vec3, device="cpu") for _ in range(2))
    given = [tables, wp.array(points[order], dtype=wp.vec3, device="cpu"), pulled, found]
    wp.launch_tiled(measure, dim=[1], inputs=given, block_dim=1, device="cpu")
    both = pulled.numpy(), found.numpy()
    for values in both:
        assert not values[count:].any()
    back = np.argsort(order)
    return both[0][back], both[1][back]


def moved(mesh: PolygonMesh, stretch: float) -> np.ndarray:
    """Its points, stretched, and each a little in or out."""
    rng = np.random.default_rng(0)
    return (stretch * np.asarray(mesh.points) * rng.uniform(0.9, 1.1, (len(mesh.points), 1))).astype(np.float32)


@pytest.mark.parametrize(("mesh", "held"), [(QUADS, 0), (QUADS, 1), (QUADS, 2), (TRIANGLES, 0)])
def test_area_vectors_are_the_gradient_of_the_volume(mesh: PolygonMesh, held: int) -> None:
    """Of a volume that is cubic in each place, central differences are exact but for rounding, 1e-10 over 1e-4."""
    points = moved(mesh, 1.0)
    _, found = measured(mesh, points, held)
    np.testing.assert_allclose(found, gradient(mesh, points.astype(np.float64)), atol=1e-7)


@pytest.mark.parametrize("held", [1, 2])
@pytest.mark.parametrize("kind", ["neo_hookean", "mooney_rivlin"])
@pytest.mark.parametrize("stretch", [0.9, 1.1, 1.6], ids=["slack", "wrinkled here and there", "taut"])
def test_quads_pull_alike_whether_threads_keep_them(stretch: float, kind: Kind, held: int) -> None:
    """Up to float32's rounding; and all pulls add up to nothing."""
    points = moved(QUADS, stretch)
    kept, read = (measured(QUADS, points, each, kind)[0] for each in (held, 0))
    largest = np.abs(read).max()
    assert largest > 0.0
    np.testing.assert_allclose(kept, read, atol=2e-5 * largest)
    np.testing.assert_allclose(kept.sum(axis=0), 0.0, atol=1e-5 * largest)


@pytest.mark.parametrize("kind", ["neo_hookean", "mooney_rivlin"])
@pytest.mark.parametrize("stretch", [0.9, 1.6], ids=["slack", "taut"])
def test_pairs_pull_alike_where_threads_have_their_ends(stretch: float, kind: Kind) -> None:
    points = moved(QUADS, stretch)
    kept, read = measured_at_ends(QUADS, points, kind), measured(QUADS, points, 0, kind)
    for of_ends, expected in zip(kept, read, strict=True):
        np.testing.assert_allclose(of_ends, expected, atol=2e-5 * np.abs(expected).max())


def uneven() -> PolygonMesh:
    """Quads with angles of all kinds."""
    mesh = grid(12, 12)
    aside = np.random.default_rng(0).uniform(-0.25, 0.25, (len(mesh.points), 3))
    return replace(mesh, points=np.asarray(mesh.points) + aside)


@pytest.mark.parametrize("mesh", [QUADS, uneven()], ids=["sphere", "uneven"])
def test_taut_quads_of_a_linear_law_are_told_by_sums(mesh: PolygonMesh) -> None:
    """They bound the trace of each triangle from above, whatever shape it has taken; also one that is flat, whose edges
    are each other's opposite."""
    quads = membrane_quads(build_model(Scene(balloon=[Balloon(mesh=mesh, material=Material(preset="latex"))]), "cpu"))
    steep = sums_of(quads)[2, :, 2:]
    d1, beside = np.random.default_rng(0).normal(size=(2, len(steep), 3))
    for d2 in (beside, -d1):
        squares = np.stack([(d**2).sum(axis=1) for d in (d1, d2, d2 - d1)], axis=1)
        for corner in range(4):
            cotangents = shapes_of(quads)[:, corner, :3]
            of_corner = np.roll(steep, -corner, axis=1)
            assert ((cotangents * squares).sum(axis=1) <= (of_corner * squares[:, :2]).sum(axis=1) * (1.0 + 1e-6)).all()


def paired_corners(corners: np.ndarray, pairs: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Of the two quads of each pair, turned."""
    ordered = (np.arange(4) + pairs[:, 2:, None]) % 4
    first, second = (np.take_along_axis(corners[pairs[:, n]], ordered[:, n], axis=1) for n in (0, 1))
    return first, second


@pytest.mark.parametrize(
    ("mesh", "most"), [(quad_sphere(9), 3), (quad_sphere(4), 3), (cube(), 3), (grid(4, 4), 3), (grid(2, 5), 3)]
)
def test_each_quad_is_in_a_pair_that_shares_an_edge(mesh: PolygonMesh, most: int) -> None:
    corners = mesh.face_vertex_indices.reshape(-1, 4).astype(np.int64)
    pairs = paired(corners, np.zeros(len(corners), dtype=np.int64))
    np.testing.assert_array_equal(np.sort(pairs[:, :2], axis=None), np.arange(len(corners)))
    first, second = paired_corners(corners, pairs)
    np.testing.assert_array_equal(first[:, 1:3], second[:, [0, 3]])
    assert np.bincount(np.concatenate([first, second[:, 1:3]], axis=1).ravel()).max() <= most


def test_some_meshes_have_no_such_pairs() -> None:
    """Nine quads; three in a T of four, whose fourth has no neighbor that is free; two that are wound against each
    other."""
    strip = grid(3, 1).face_vertex_indices.reshape(-1, 4).astype(np.int64)
    branch = np.concatenate([strip, [[5, 6, 9, 8]]])  # at the middle
    against = grid(2, 1).face_vertex_indices.reshape(-1, 4).astype(np.int64)
    against[1] = against[1, ::-1]
    odd = grid(3, 3).face_vertex_indices.reshape(-1, 4).astype(np.int64)
    for corners in (odd, branch, against):
        assert len(paired(corners, np.zeros(len(corners), dtype=np.int64))) == 0


def test_no_pair_is_of_two_balloons() -> None:
    corners = quad_sphere(2).face_vertex_indices.reshape(-1, 4).astype(np.int64)
    both = np.concatenate([corners, corners + corners.max() + 1])
    balloons = np.repeat([0, 1], len(corners))
    pairs = paired(both, balloons)
    assert len(pairs) == len(corners)
    assert (balloons[pairs[:, 0]] == balloons[pairs[:, 1]]).all()
    strip = grid(2, 1).face_vertex_indices.reshape(-1, 4).astype(np.int64)
    assert len(paired(strip, np.array([0, 0]))) == 1
    assert len(paired(strip, np.array([0, 1]))) == 0


def test_threads_keep_single_quads_where_some_have_no_pair() -> None:
    mesh = prism(4)  # without its lid: five quads
    mesh = mesh_of(mesh.points.tolist(), mesh.face_vertex_indices.reshape(-1, 4)[1:].tolist())
    material = Material(preset="latex")
    model = build_model(Scene(balloon=[Balloon(mesh=mesh, material=material)]), "cpu")
    film = film_layout(model, model_traits(model))
    assert film is not None
    held = held_layout(model, film, 6, 3)
    assert held == film._replace(held=6)


def gradient(mesh: PolygonMesh, points: np.ndarray, step: float = 1e-4) -> np.ndarray:
    """Of the enclosed volume by each place [m^2]."""
    found = np.zeros_like(points)
    for place in np.ndindex(*points.shape):
        for sign in (1.0, -1.0):
            moved = points.copy()
            moved[place] += sign * step
            found[place] += sign * signed_volume(replace(mesh, points=moved)) / (2.0 * step)
    return found
