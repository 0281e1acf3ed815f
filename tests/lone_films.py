"""Faces of membranes as the threads of a block measure them, by themselves, on a CPU."""

import numpy as np
import warp as wp
from meshes import mesh_of, quad_sphere

from balloon_warp import Balloon, Inflation, Material, PolygonMesh, Scene
from balloon_warp.kernels.loops.held_quads import quads_of
from balloon_warp.kernels.loops.membrane_faces import membrane_faces_of
from balloon_warp.kernels.memory import put_in_tile
from balloon_warp.kernels.options import OPTIONS
from balloon_warp.kernels.params import numbers_reader, params_functions
from balloon_warp.kernels.tables import Tables
from balloon_warp.model import build_model
from balloon_warp.scene.schema.material import Kind
from balloon_warp.schedules.features import model_features
from balloon_warp.schedules.membrane_faces import membrane_face_entries, membrane_face_layout, membrane_face_table
from balloon_warp.schedules.tables import make_tables

QUADS = quad_sphere(3, 0.1)
TRIANGLES = mesh_of(QUADS.points.tolist(), [c for a, b, d, e in QUADS.face_vertex_indices.reshape(-1, 4).tolist()
                                            for c in ([a, b, d], [a, d, e])])  # fmt: skip


def latex(mesh: PolygonMesh, kind: Kind, viscosity: float = 0.0) -> Scene:
    """Return a latex balloon with nothing in it."""
    gas, material = Inflation(kind="gas", start_pressure=0.0), Material(preset="latex", kind=kind, viscosity=viscosity)
    return Scene(balloon=[Balloon(mesh=mesh, material=material, inflation=gas, damping=0.0)])


def measured(
    mesh: PolygonMesh,
    points: np.ndarray,
    held: int,
    kind: Kind = "neo_hookean",
    viscosity: float = 0.0,
    velocities: np.ndarray | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Return the pull of faces on particles [N], and their area vectors [m^2].

    Args: held: number of quads whose data each thread keeps. velocities: velocities [m/s], for viscous rubber."""
    model = build_model(latex(mesh, kind, viscosity), "cpu")
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
    membrane_faces, quads = (
        membrane_faces_of(features, membrane_face),
        quads_of(features, membrane_face) if held else None,
    )
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
            pull, area_vector = membrane_faces.take(
                t, params, membrane_faces.read_places(t, params, True), pulls, areas
            )
            pulled[particle] = pull
            found[particle] = area_vector

    pulled, found = (wp.zeros(count, dtype=wp.vec3, device="cpu") for _ in range(2))
    moving = np.zeros_like(points) if velocities is None else velocities
    given = [tables, *(wp.array(each, dtype=wp.vec3, device="cpu") for each in (points, moving)), pulled, found]
    wp.launch_tiled(measure, dim=[1], inputs=given, block_dim=1, device="cpu")
    return pulled.numpy(), found.numpy()


def moved(mesh: PolygonMesh, stretch: float) -> np.ndarray:
    """Return a mesh's points, stretched and jittered in and out."""
    rng = np.random.default_rng(0)
    return (stretch * np.asarray(mesh.points) * rng.uniform(0.9, 1.1, (len(mesh.points), 1))).astype(np.float32)
