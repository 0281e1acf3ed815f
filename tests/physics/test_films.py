"""Membrane faces as blocks compute them, area vectors included, which otherwise happens on a GPU alone."""

from dataclasses import replace

import numpy as np
import pytest
import warp as wp
from meshes import mesh_of, quad_sphere

from balloon_warp import Balloon, Inflation, Material, PolygonMesh, Scene
from balloon_warp.kernels import OPTIONS
from balloon_warp.kernels.compose import numbers_reader, params_functions
from balloon_warp.kernels.loops.membranes import membrane_faces_of
from balloon_warp.kernels.loops.quads import quads_of
from balloon_warp.kernels.memory import put_in_tile
from balloon_warp.kernels.tables import Tables
from balloon_warp.mesh.topology import signed_volume
from balloon_warp.model import build_model
from balloon_warp.schedules.features import model_features
from balloon_warp.schedules.membranes import membrane_face_entries, membrane_face_layout, membrane_face_table
from balloon_warp.schedules.tables import make_tables

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


@pytest.mark.always
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
