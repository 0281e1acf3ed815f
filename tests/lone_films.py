"""Faces of membranes as the threads of a block measure them, by themselves, on a CPU."""

import numpy as np
import warp as wp
from meshes import mesh_of, quad_sphere

from balloon_warp.kernels.loops.springs import spring_loop
from balloon_warp.kernels.memory import in_tile, put_in_tile
from balloon_warp.kernels.options import OPTIONS
from balloon_warp.kernels.own import numbers_reader, own_functions
from balloon_warp.kernels.schedules.block.ends import stretch_function
from balloon_warp.kernels.schedules.block.films import films_of
from balloon_warp.kernels.schedules.block.memory import Layout, Seat, no_springs
from balloon_warp.kernels.tables import Tables
from balloon_warp.mesh import PolygonMesh
from balloon_warp.model import build_model
from balloon_warp.scene import Balloon, Inflation, Material, Scene
from balloon_warp.scene.schema.material import Kind
from balloon_warp.schedules.films import film_entries, film_layout, film_order, film_table, held_layout
from balloon_warp.schedules.renumber import renumbered
from balloon_warp.schedules.tables import make_tables
from balloon_warp.schedules.traits import model_traits

QUADS = quad_sphere(3, 0.1)
TRIANGLES = mesh_of(QUADS.points.tolist(), [c for a, b, d, e in QUADS.face_vertex_indices.reshape(-1, 4).tolist()
                                            for c in ([a, b, d], [a, d, e])])  # fmt: skip


def latex(mesh: PolygonMesh, kind: Kind, viscosity: float = 0.0) -> Scene:
    """A balloon with nothing in it."""
    gas, material = Inflation(kind="gas", start_pressure=0.0), Material(preset="latex", kind=kind, viscosity=viscosity)
    return Scene(balloon=[Balloon(mesh=mesh, material=material, inflation=gas, damping=0.0)])


def measured(
    mesh: PolygonMesh,
    points: np.ndarray,
    held: int,
    kind: Kind = "mooney_rivlin",
    viscosity: float = 0.0,
    velocities: np.ndarray | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """What faces pull particles with [N], and their area vectors [m^2].

    Args:
        held: of how many quads each thread keeps what it knows, 2 of a pair.
        velocities: where rubber is viscous.
    """
    model = build_model(latex(mesh, kind, viscosity), "cpu")
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
        velocities: wp.array[wp.vec3],
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
            films.stretch(t, seat, read_numbers(t, 0, 0), first, tile, velocities, pulls, areas)
        for particle in range(count):
            mine = films.read(t, 0, read_own(t, 0, particle), particle, True)
            taken = films.take(t, seat, particle, mine, pulls, areas)
            pulled[particle] = taken.pull
            found[particle] = taken.area_vector

    pulled, found = (wp.zeros(count, dtype=wp.vec3, device="cpu") for _ in range(2))
    moving = np.zeros_like(points) if velocities is None else velocities
    given = [tables, *(wp.array(each, dtype=wp.vec3, device="cpu") for each in (points, moving)), pulled, found]
    wp.launch_tiled(measure, dim=[1], inputs=given, block_dim=1, device="cpu")
    return pulled.numpy(), found.numpy()


def measured_at_ends(mesh: PolygonMesh, points: np.ndarray, kind: Kind) -> tuple[np.ndarray, np.ndarray]:
    """The same where threads have the particles at the ends of the edges that their pairs share."""
    model = build_model(latex(mesh, kind), "cpu")
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
