"""Spring generation of the paper, written out as its listings stand, loop by loop. Slow, and plain to check."""

from balloon_warp.mesh import PolygonMesh

Pairs = set[tuple[int, int]]


def paper_springs(mesh: PolygonMesh) -> tuple[Pairs, Pairs, Pairs]:
    """Return structural, shear and flexion pairs, the lower particle first."""
    faces = _faces(mesh)
    particles = range(mesh.vertex_count)
    nearest_faces = {p: [face for face in faces if p in face] for p in particles}
    nearest_particles = {p: {q for face in nearest_faces[p] for q in face} for p in particles}

    structural: Pairs = set()
    shear: Pairs = set()
    for p in particles:
        for p2 in nearest_particles[p]:
            for face in nearest_faces[p]:
                if _should_create_structural_spring(face, p, p2):
                    structural.add((min(p, p2), max(p, p2)))
                elif _should_create_shear_spring(face, p, p2):
                    shear.add((min(p, p2), max(p, p2)))
    # Neighbors in one face and across from each other in another: the pair is structural, and has one spring.
    shear -= structural

    flexion: Pairs = set()
    for p in particles:
        for p2 in nearest_particles[p]:
            if any(_should_create_structural_spring(face, p, p2) for face in nearest_faces[p]):
                for p3 in nearest_particles[p2]:
                    if any(_should_create_structural_spring(face, p2, p3) for face in nearest_faces[p3]):
                        pair = (min(p, p3), max(p, p3))
                        if pair not in structural and pair not in shear and p != p3:
                            flexion.add(pair)
    return structural, shear, flexion


def _faces(mesh: PolygonMesh) -> list[list[int]]:
    corners = iter(mesh.face_vertex_indices.tolist())
    return [[next(corners) for _ in range(count)] for count in mesh.face_vertex_counts.tolist()]


def _should_create_structural_spring(face: list[int], p: int, p2: int) -> bool:
    """Return whether p and p2 are adjacent in the face."""
    sides = list(zip(face, face[1:] + face[:1], strict=True))
    return p != p2 and ((p, p2) in sides or (p2, p) in sides)


def _should_create_shear_spring(face: list[int], p: int, p2: int) -> bool:
    """Return whether p and p2 are opposite in the face."""
    return p != p2 and p in face and p2 in face and not _should_create_structural_spring(face, p, p2)
