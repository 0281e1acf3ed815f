"""Springs against hand counts, closed forms and the paper's listings."""

import numpy as np
import pytest
from meshes import cube, grid, joined, mesh_of, moebius, polygon, prism, quad_sphere, tetrahedron, torus
from meshes import two_quads_at_a_vertex as two_quads

from balloon_warp import InputError, PolygonMesh
from balloon_warp.mesh.crossings import LARGEST_FAN
from balloon_warp.springs import SpringKind, Springs, build_springs
from balloon_warp.springs.build import build_hinges


def counts(mesh: PolygonMesh) -> tuple[int, int, int]:
    springs = build_springs(mesh)
    return springs.structural_count, springs.shear_count, springs.flexion_count


def pairs_of(springs: Springs, kind: SpringKind) -> set[tuple[int, int]]:
    return {(int(first), int(second)) for first, second in springs.pairs[springs.kind == kind]}


Pairs = set[tuple[int, int]]


def paper_springs(mesh: PolygonMesh) -> tuple[Pairs, Pairs, Pairs]:
    """Return structural, shear and flexion pairs, the lower particle first, as the paper's listings stand, loop by
    loop: slow, and plain to check."""
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


# Counted on paper: edges of faces; diagonals of faces; pairs two edges apart that share no face.
HAND_COUNTS = {
    "one quad": (grid(1, 1), (4, 2, 0)),
    "2x2 grid: three rows and three columns of three particles each": (grid(2, 2), (12, 8, 6)),
    "3x3 grid: four rows and four columns of four particles each": (grid(3, 3), (24, 18, 16)),
    "cube: opposite corners are three edges apart": (cube(), (12, 12, 0)),
    "tetrahedron": (tetrahedron(), (6, 0, 0)),
    "pentagonal prism: 2 x 5 diagonals of pentagons, 5 x 2 of quads": (prism(5), (15, 20, 0)),
    "two quads at one vertex: two neighbors on either side of it": (two_quads(), (8, 4, 4)),
    "Moebius strip of 7: 7 rungs and a border of 14 edges, flexion along the border": (moebius(7), (21, 14, 14)),
    "octagon: 8 x 5 / 2 diagonals": (polygon(8), (8, 20, 0)),
    "three triangles on one edge": (mesh_of(np.eye(5, 3), [[0, 1, 2], [0, 1, 3], [0, 1, 4]]), (7, 0, 3)),
    "a vertex of valence 6 amid triangles: three opposite pairs and six of every second": (
        mesh_of([[0, 0, 0], *polygon(6).points], [[0, i, i % 6 + 1] for i in range(1, 7)]),
        (12, 0, 9),
    ),
    "torus of 4 around: opposite particles have two between them, and one spring": (torus(4, 5), (40, 40, 2 * 5 + 20)),
    "a diagonal that is an edge": (mesh_of(np.eye(4, 3), [[0, 1, 2, 3], [0, 1, 2]]), (5, 1, 0)),
    "a triangle written as a quad with a repeated corner": (mesh_of(np.eye(3), [[0, 1, 1, 2]]), (3, 0, 0)),
    "two cubes": (joined(cube(), cube()), (24, 24, 0)),
    "7x4 grid": (grid(7, 4), (7 * 5 + 4 * 8, 2 * 7 * 4, 6 * 5 + 8 * 3)),
    # 6 n^2 quads have 12 n^2 edges and 12 n^2 diagonals. Two neighbors of a particle of valence 4 that share no quad
    # are opposite to each other: two pairs around each of the 6 n^2 + 2 particles but the 8 corners, of valence 3.
    **{f"quad sphere {n}": (quad_sphere(n), (12 * n**2, 12 * n**2, 12 * n**2 - 12)) for n in (1, 2, 3, 4, 9, 16)},
}


@pytest.mark.parametrize("case", HAND_COUNTS)
def test_hand_counts(case: str) -> None:
    mesh, expected = HAND_COUNTS[case]
    assert counts(mesh) == expected


@pytest.mark.parametrize("seed", range(60))
def test_polygon_soups_match_the_listings_of_the_paper(seed: int) -> None:
    random = np.random.default_rng(seed)
    vertex_count = int(random.integers(4, 14))
    sizes = random.integers(3, 7, size=random.integers(1, 10))
    # With replacement: faces that repeat corners, overlap, and share edges in any number come up.
    faces = [random.integers(0, vertex_count, size=size).tolist() for size in sizes]
    mesh = mesh_of(random.normal(size=(vertex_count, 3)), faces)
    springs = build_springs(mesh)
    assert tuple(pairs_of(springs, kind) for kind in SpringKind) == paper_springs(mesh)
    assert len({tuple(pair) for pair in springs.pairs.tolist()}) == springs.count  # each pair once


def test_closed_and_one_sided_meshes_match_the_listings_of_the_paper() -> None:
    mesh = joined(prism(6), quad_sphere(3), moebius(5))
    springs = build_springs(mesh)
    assert tuple(pairs_of(springs, kind) for kind in SpringKind) == paper_springs(mesh)


def test_order_types_and_rest_lengths() -> None:
    springs = build_springs(cube())
    assert (springs.pairs.dtype, springs.kind.dtype, springs.rest_lengths.dtype) == (np.int32, np.int32, np.float64)
    assert (springs.pairs[:, 0] < springs.pairs[:, 1]).all()
    rows = np.column_stack([springs.kind, springs.pairs]).tolist()
    assert rows == sorted(rows)
    # A unit cube has no other lengths; its coordinates and 2 are exact, so the square root is correctly rounded.
    assert set(springs.rest_lengths[springs.kind == SpringKind.STRUCTURAL]) == {1.0}
    assert set(springs.rest_lengths[springs.kind == SpringKind.SHEAR]) == {np.sqrt(2.0)}
    flat = build_springs(grid(2, 2))
    assert set(flat.rest_lengths[flat.kind == SpringKind.FLEXION]) == {2.0}


@pytest.mark.parametrize("chunk", [1, 7, 100])
def test_springs_do_not_depend_on_how_many_pairs_are_worked_on_at_once(
    monkeypatch: pytest.MonkeyPatch, chunk: int
) -> None:
    whole = build_springs(prism(7))
    monkeypatch.setattr("balloon_warp.springs.build.CHUNK_PAIRS", chunk)
    np.testing.assert_array_equal(build_springs(prism(7)).pairs, whole.pairs)


def wheel(spokes: int, hub: int = 0) -> PolygonMesh:
    """Return triangles around a vertex, the others in order on the rim."""
    rim = [vertex for vertex in range(spokes + 1) if vertex != hub]
    turn = 2.0 * np.pi * np.arange(spokes) / spokes
    points = np.zeros((spokes + 1, 3))
    points[rim, :2] = np.stack([np.cos(turn), np.sin(turn)], axis=1)
    return mesh_of(points, [[hub, a, b] for a, b in zip(rim, rim[1:] + rim[:1], strict=True)])


@pytest.mark.parametrize("hub", [0, 77])
def test_flexion_springs_past_a_hub_go_to_the_other_side_only(hub: int) -> None:
    at_limit = build_springs(wheel(LARGEST_FAN, hub))
    # All pairs around the hub, but those on the rim that are structural, and no others: the paper's rule.
    assert at_limit.flexion_count == LARGEST_FAN * (LARGEST_FAN - 1) // 2 - LARGEST_FAN
    spokes = 2 * LARGEST_FAN
    springs = build_springs(wheel(spokes, hub))
    lengths = springs.rest_lengths[springs.kind == SpringKind.FLEXION]
    # A diameter for each two spokes; and past each rim vertex, which has three neighbors, one pair on the rim.
    assert np.count_nonzero(np.isclose(lengths, 2.0)) == spokes // 2
    assert len(lengths) == spokes // 2 + spokes


@pytest.mark.parametrize(
    ("mesh", "sentence"),
    [
        (polygon(5000), "face 1 (counted from 1) has 5,000 corners; springs can be made for at most 4,096"),
        (
            mesh_of(np.eye(4096, 3), 9 * [list(range(4096))]),
            "mesh: has 75,479,040 pairs of corners in its faces; springs can be made for at most 16,777,216",
        ),
    ],
)
def test_springs_without_end_are_refused(mesh: PolygonMesh, sentence: str) -> None:
    with pytest.raises(InputError) as refusal:
        build_springs(mesh)
    assert str(refusal.value) == sentence


@pytest.mark.parametrize("mesh", [joined(prism(5), tetrahedron()), torus(5, 4)], ids=["prism", "torus"])
def test_gradients_of_hinges_are_the_slopes_of_their_angles(mesh: PolygonMesh) -> None:
    """Slopes are by both ends and by each wing as a whole; central differences are off by 1e-5 of a side, squared."""
    hinges, move = build_hinges(mesh), 1e-5
    points = mesh.points + 0.1 * np.random.default_rng(1).normal(size=mesh.points.shape)
    wings = np.split(hinges.wing_particles, hinges.wing_offsets[1:-1])
    for number, found in enumerate(hinges.gradients(points)):
        for part, size in zip([*hinges.ends[number], *wings[2 * number : 2 * number + 2]], found, strict=True):
            slope = np.zeros(3)
            for axis in range(3):
                for way in (-move, move):
                    moved = points.copy()
                    moved[part, axis] += way
                    slope[axis] += hinges.angles(moved)[number] / (2.0 * way)
            np.testing.assert_allclose(np.linalg.norm(slope), size, rtol=1e-7)
