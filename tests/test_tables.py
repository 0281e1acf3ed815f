"""Tables that kernels read, against the faces of a mesh one by one."""

from collections import defaultdict

import numpy as np
import pytest
from meshes import cube, halved, joined, prism, quad_sphere

from balloon_warp import Balloon, Inflation, Material, PolygonMesh, Scene, Stiffness
from balloon_warp.mesh.topology import face_starts
from balloon_warp.model import Model, build_model
from balloon_warp.schedules.features import model_features
from balloon_warp.schedules.membranes import membrane_face_layout, membrane_face_table
from balloon_warp.schedules.slices import kind_slots, quad_rings, slot_table, spring_ends
from balloon_warp.schedules.tables import make_tables, quads_at_particles

MIXED = joined(quad_sphere(2), halved(cube()))
MESHES = {"triangles": halved(quad_sphere(2)), "prism": prism(5), "mixed": MIXED}
AIR = Inflation(kind="gas", start_pressure=0.0)


def two_of(mesh: PolygonMesh, **fields) -> Model:
    """Return a model of two balloons, whose particles and faces have numbers after those of the first."""
    balloons = [Balloon(mesh=mesh, position=(4.0 * number, 0.0, 0.0), inflation=AIR, **fields) for number in range(2)]
    return build_model(Scene(balloon=balloons), "cpu")


def others_at_corners(mesh: PolygonMesh) -> list[list[tuple[int, ...]]]:
    """Return, for each vertex, the other corners of each of its faces in order from there."""
    found = defaultdict(list)
    for first, count in zip(face_starts(mesh).tolist(), mesh.face_vertex_counts.tolist(), strict=True):
        face = mesh.face_vertex_indices[first : first + count].tolist()
        for corner, vertex in enumerate(face):
            found[vertex].append((*face[corner + 1 :], *face[:corner]))
    return [sorted(found[vertex]) for vertex in range(mesh.vertex_count)]


@pytest.mark.parametrize("name", MESHES)
def test_fans_have_the_other_corners_of_all_faces_at_a_particle(name: str):
    model = two_of(MESHES[name])
    fans = make_tables(model, model_features(model)).fans
    offsets, begins, particles = (getattr(fans, field).numpy() for field in ("offsets", "begins", "particles"))
    assert len(offsets) == model.particle_count + 1
    found = [
        sorted(tuple(particles[begins[entry] : begins[entry + 1]].tolist()) for entry in range(first, end))
        for first, end in zip(offsets[:-1].tolist(), offsets[1:].tolist(), strict=True)
    ]
    once = others_at_corners(MESHES[name])
    again = [[tuple(each + len(once) for each in fan) for fan in fans] for fans in once]
    assert found == once + again


def test_quads_have_their_other_corners_from_the_one_before():
    model = two_of(quad_sphere(2))
    particles, others = quads_at_particles(model)
    once = others_at_corners(quad_sphere(2))
    for number in range(model.particle_count):
        again, vertex = divmod(number, len(once))
        found = sorted(tuple(row) for row in (others[particles == number, ::-1] - again * len(once)).tolist())
        assert found == once[vertex]


@pytest.mark.parametrize("name", ["triangles", "mixed"])
def test_membrane_faces_know_the_triangles_at_their_corners(name: str):
    """Each triangle is at a corner of its face: of its own three, or of a quad, which has one there."""
    rubber = Material(kind="neo_hookean", thickness=1e-3, softening=0.4, softening_energy=1e3)
    model = two_of(MESHES[name], material=rubber)
    table = membrane_face_table(model, membrane_face_layout(model, model_features(model)))
    triangles = model.membrane_corners.numpy().reshape(-1, 3)
    corners, numbers = table.corners.numpy(), table.numbers.numpy()
    is_quad = corners[:, 0] != corners[:, 2]
    assert is_quad.any() == (name == "mixed")
    at = np.where(is_quad[:, None], np.ones((1, 4), dtype=bool), [[True, False, False, False]])
    assert sorted(numbers[at].tolist()) == list(range(len(triangles)))
    assert (triangles[numbers[at]] == corners[at][:, None]).any(axis=1).all()


@pytest.mark.parametrize("name", MESHES)
def test_particles_know_their_roles_in_hinges(name: str):
    """Role 0 and 1 are the ends of the edge between two faces, 2 and 3 the other corners of the one and the other."""
    mesh = MESHES[name]
    model = two_of(mesh, stiffness=Stiffness(torsion=1.0))
    hinges = make_tables(model, model_features(model)).hinges
    ends, wings, corners = (getattr(hinges, each).numpy() for each in ("ends", "wing_offsets", "wing_particles"))
    parts = [(ends[number], *(corners[wings[k] : wings[k + 1]] for k in (2 * number, 2 * number + 1)))
             for number in range(len(ends))]  # fmt: skip
    found = [{tuple(sorted(part.tolist())) for part in of} for of in parts]
    faces = np.split(mesh.face_vertex_indices, face_starts(mesh)[1:])
    edges = defaultdict(list)
    for face in faces:
        for a, b in zip(face.tolist(), np.roll(face, -1).tolist(), strict=True):
            edges[min(a, b), max(a, b)].append(tuple(sorted({*face.tolist()} - {a, b})))
    expected = [{edge, *sides} for edge, sides in edges.items()]
    again = [{tuple(v + mesh.vertex_count for v in part) for part in parts} for parts in expected]
    assert sorted(map(sorted, found)) == sorted(map(sorted, expected + again))
    offsets, roles = hinges.particle_offsets.numpy(), hinges.particle_roles.numpy()
    for particle in range(model.particle_count):
        known = [4 * number + role for number, ((a, b), *of) in enumerate(parts)
                 for role, part in enumerate(([a], [b], *of)) if particle in part]  # fmt: skip
        assert roles[offsets[particle] : offsets[particle + 1]].tolist() == known


@pytest.mark.parametrize("ringed", [False, True])
def test_slots_have_each_particle_s_springs_first(ringed: bool):
    """Structural and shear springs go around a particle in its ring; slots left over are of no stiffness."""
    model = two_of(quad_sphere(3))
    ends, ring = spring_ends(model), quad_rings(model)
    assert ring is not None
    table, bounds = slot_table(model, ends, ring if ringed else None), np.cumsum([0, *kind_slots(ends)])
    neighbors, scales, lengths = (getattr(table, each).numpy() for each in ("neighbors", "scales", "rest_lengths"))
    for particle, kind in np.ndindex(model.particle_count, 3):
        own = (ends.particle == particle) & (ends.kind == kind)
        known = sorted(zip(ends.neighbor[own], ends.scale[own], ends.rest_length[own].astype(np.float32), strict=True))
        slots, used = slice(bounds[kind], bounds[kind + 1]), own.sum()
        found = list(zip(*(each[slots, particle] for each in (neighbors, scales, lengths)), strict=True))
        assert sorted(each for each in found if each[1] > 0.0) == known
        assert {each[0] for each in found if each[1] == 0.0} <= {particle}
        if ringed and kind < 2:
            assert neighbors[slots, particle][:used].tolist() == ring[kind][:used, particle].tolist()
    assert table.valences.numpy().tolist() == ends.by_kind[:, 0].tolist()
