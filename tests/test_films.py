"""Faces of membranes as blocks go through them, where they hand out area vectors, too: on a GPU alone otherwise."""

from dataclasses import replace

import numpy as np
import pytest
import warp as wp
from meshes import mesh_of, quad_sphere

from balloon_warp.kernels.loops.springs import spring_loop
from balloon_warp.kernels.memory import in_tile, put_in_tile
from balloon_warp.kernels.options import OPTIONS
from balloon_warp.kernels.own import numbers_reader
from balloon_warp.kernels.schedules.block_films import films_of
from balloon_warp.kernels.schedules.block_memory import Layout, Seat, no_springs
from balloon_warp.kernels.tables import Tables
from balloon_warp.mesh import PolygonMesh
from balloon_warp.mesh.geometry import signed_volume
from balloon_warp.model import build_model
from balloon_warp.scene import Balloon, Inflation, Material, Scene
from balloon_warp.schedules.films import film_entries, film_layout, film_table
from balloon_warp.schedules.tables import make_tables
from balloon_warp.schedules.traits import model_traits

QUADS = quad_sphere(3, 0.1)
TRIANGLES = mesh_of(QUADS.points.tolist(), [c for a, b, d, e in QUADS.face_vertex_indices.reshape(-1, 4).tolist()
                                            for c in ([a, b, d], [a, d, e])])  # fmt: skip


@pytest.mark.parametrize("mesh", [QUADS, TRIANGLES], ids=["quads", "triangles"])
def test_area_vectors_are_the_gradient_of_the_volume(mesh: PolygonMesh) -> None:
    """Of a volume that is cubic in each place, central differences are exact but for rounding, 1e-10 over 1e-4."""
    gas = Inflation(kind="gas", start_pressure=0.0)
    model = build_model(Scene(balloon=[Balloon(mesh=mesh, material=Material(preset="latex"), inflation=gas)]), "cpu")
    traits = model_traits(model)
    film = film_layout(model, traits)
    assert film is not None
    assert film.areas
    tables = make_tables(model, traits, in_block=True)
    tables.membranes.films = film_table(model, film, resident=True)
    count, places = model.particle_count, film_entries(model)
    layout = Layout(1, count, resident=True, faces=places, film=film)
    films = films_of(traits, layout, wp.int32, no_springs, spring_loop(traits, in_tile))
    read_numbers = numbers_reader(traits.columns)

    @wp.kernel(module="unique", enable_backward=False, module_options=OPTIONS)
    def measure(
        t: Tables,  # pyright: ignore[reportGeneralTypeIssues] - a struct
        points: wp.array[wp.vec3],
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
        films.stretch(t, seat, read_numbers(t, 0, 0), tile, points, pulls, areas)
        for particle in range(count):
            held = films.take(t, seat, particle, films.held(), pulls, areas)
            found[particle] = held.area_vector

    rng = np.random.default_rng(0)
    points = (np.asarray(mesh.points) * rng.uniform(0.9, 1.1, (len(mesh.points), 1))).astype(np.float32)
    found = wp.zeros(count, dtype=wp.vec3, device="cpu")
    given = [tables, wp.array(points, dtype=wp.vec3, device="cpu"), found]
    wp.launch_tiled(measure, dim=[1], inputs=given, block_dim=1, device="cpu")
    np.testing.assert_allclose(found.numpy(), gradient(mesh, points.astype(np.float64)), atol=1e-7)


def gradient(mesh: PolygonMesh, points: np.ndarray, step: float = 1e-4) -> np.ndarray:
    """Of the enclosed volume by each place [m^2]."""
    found = np.zeros_like(points)
    for place in np.ndindex(*points.shape):
        for sign in (1.0, -1.0):
            moved = points.copy()
            moved[place] += sign * step
            found[place] += sign * signed_volume(replace(mesh, points=moved)) / (2.0 * step)
    return found
