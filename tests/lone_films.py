"""Faces of membranes as the threads of a block measure them, by themselves, on a CPU."""

import numpy as np
import warp as wp
from meshes import mesh_of, quad_sphere

from balloon_warp.kernels.loops.films import films_of
from balloon_warp.kernels.loops.held_quads import quads_of
from balloon_warp.kernels.memory import put_in_tile
from balloon_warp.kernels.options import OPTIONS
from balloon_warp.kernels.own import numbers_reader, own_functions
from balloon_warp.kernels.tables import Tables
from balloon_warp.mesh import PolygonMesh
from balloon_warp.model import build_model
from balloon_warp.scene import Balloon, Inflation, Material, Scene
from balloon_warp.scene.schema.material import Kind
from balloon_warp.schedules.films import film_entries, film_layout, film_table
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
        held: of how many quads each thread keeps what it knows.
        velocities: where rubber is viscous.
    """
    model = build_model(latex(mesh, kind, viscosity), "cpu")
    traits = model_traits(model)
    film = film_layout(model, traits)
    assert film is not None
    assert film.areas
    count, threads = model.particle_count, -(-model.face_count // held) if held else 1
    film = film._replace(quads=held, room=held * threads, capacity=count)
    film = film._replace(tile=film_entries(model, film))
    places, faces = film.tile, model.face_count
    tables = make_tables(model, traits, in_block=True)
    tables.membranes.films = film_table(model, film)
    films, quads = films_of(traits, film), quads_of(traits, film) if held else None
    hold, stretch = (quads.hold, quads.stretch) if quads else (None, None)
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
        films.clear(t, pulls, areas)
        if wp.static(quads is not None):
            for thread in range(threads):
                n = read_numbers(t, 0, 0)
                stretch(t, 0, thread, n, hold(t, 0, n, thread), tile, pulls, areas)  # pyright: ignore
        else:
            for face in range(faces):
                films.stretch(t, 0, face, tile, velocities, pulls, areas)
        for particle in range(count):
            own = read_own(t, 0, particle)
            pull, area_vector = films.take(t, own, films.read_places(t, own, True), pulls, areas)
            pulled[particle] = pull
            found[particle] = area_vector

    pulled, found = (wp.zeros(count, dtype=wp.vec3, device="cpu") for _ in range(2))
    moving = np.zeros_like(points) if velocities is None else velocities
    given = [tables, *(wp.array(each, dtype=wp.vec3, device="cpu") for each in (points, moving)), pulled, found]
    wp.launch_tiled(measure, dim=[1], inputs=given, block_dim=1, device="cpu")
    return pulled.numpy(), found.numpy()


def moved(mesh: PolygonMesh, stretch: float) -> np.ndarray:
    """Its points, stretched, and each a little in or out."""
    rng = np.random.default_rng(0)
    return (stretch * np.asarray(mesh.points) * rng.uniform(0.9, 1.1, (len(mesh.points), 1))).astype(np.float32)
