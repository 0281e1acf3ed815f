"""Laws of rubber and film against textbooks' energies and their derivatives; springs against closed forms."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import warp as wp
from law_functions import COUNT, adjoint, called, compile_together
from meshes import cube, grid, halved, joined, mesh_of, moebius, polygon, prism, quad_sphere, tetrahedron, torus
from meshes import two_quads_at_a_vertex as two_quads
from numpy.typing import NDArray
from rubber_theory import ENERGIES, MATERIALS, OGDEN, quad_energy, relaxed

from balloon_warp import Balloon, Inflation, InputError, PolygonMesh, Scene
from balloon_warp.frame import ForceReader
from balloon_warp.kernels.algebra import power
from balloon_warp.kernels.laws.membrane import MEMBRANES, neo_hookean, ogden
from balloon_warp.mesh.crossings import LARGEST_FAN
from balloon_warp.model import build_model, initial_state
from balloon_warp.model.materials import numbers_of, on_arrays, slopes_by_stretches, stiffest_modulus
from balloon_warp.model.plan import plan_model
from balloon_warp.schedules.gather import ScatterSchedule
from balloon_warp.springs import SpringKind, Springs, build_springs
from balloon_warp.springs.build import build_hinges, build_membrane

each_law = pytest.mark.parametrize("kind", list(MEMBRANES))
STILL = Inflation(kind="pressure", pressure=0.0)


def scene_of(kind: str, mesh: PolygonMesh) -> Scene:
    balloon = Balloon(mesh=mesh, material=MATERIALS[kind], inflation=STILL, damping=0.0)
    return Scene(balloon=[balloon], gravity=0.0)


def derivative(function: Callable[..., Any], *at: Any, of: int = 0, h: float = 1e-4) -> Any:
    """Return the central difference of a function by one of its arguments."""
    more, less = ([each + step * (n == of) for n, each in enumerate(at)] for step in (h, -h))
    return (function(*more) - function(*less)) / (2.0 * h)


def told_of(kind: str) -> dict[str, NDArray[np.float64]]:
    return numbers_of(plan_model(scene_of(kind, quad_sphere(1))).parameters, 0)


@each_law
def test_slopes_are_those_of_the_energy_of_textbooks(kind: str):
    energy, random = ENERGIES[kind], np.random.default_rng(0)
    first, second = random.uniform(0.7, 4.0, (2, 1000))
    first, second = np.maximum(first, second), np.minimum(first, second)
    first[:100] = second[:100]  # both alike, as in a round balloon
    found = slopes_by_stretches(MEMBRANES[kind], told_of(kind), first, second)
    expected = [derivative(energy, first, second, of=of) for of in (0, 1)]
    size = np.abs(expected).mean()
    for slope, other in zip(found, expected, strict=True):
        np.testing.assert_allclose(slope[0], other, atol=1e-6 * size, rtol=1e-6)


@each_law
def test_a_law_s_own_energy_has_its_slopes(kind: str):
    """Up to stretches of 12, where Gent's is beyond the most that it allows; differences are off by some h^2."""
    law, told = MEMBRANES[kind], told_of(kind)
    first = np.linspace(1.1, 12.0, 60)
    second = first**-0.3

    def energy(major: NDArray[np.float64], minor: NDArray[np.float64]) -> NDArray[np.float64]:
        a, b = major**2, minor**2
        values = {**told, "trace": a + b, "det": a * b, "spread": a - b}
        own = on_arrays(law.energy)
        return own(**{name: values[name] for name in own.__code__.co_varnames[: own.__code__.co_argcount]})

    expected = [derivative(energy, first, second, of=of) for of in (0, 1)]
    for slope, other in zip(slopes_by_stretches(law, told, first, second), expected, strict=True):
        np.testing.assert_allclose(slope, other, rtol=1e-5, atol=1e-6 * np.abs(other).max())


@wp.func
def neo_hookean_slopes(det: float, shear_modulus: float):
    by_trace, by_det = neo_hookean(det, shear_modulus)
    return wp.vec3(by_trace, by_det, 0.0)


def test_what_is_called_linear_is_a_number_times_the_first_invariant():
    assert [name for name, law in MEMBRANES.items() if law.linear] == ["neo_hookean"]
    det, modulus = np.random.default_rng(0).uniform(0.1, 20.0, (2, COUNT)).astype(np.float32)
    by_trace, by_det, _ = called(neo_hookean_slopes, {"det": det, "shear_modulus": modulus}, "vec3").T
    np.testing.assert_allclose(by_trace, 0.5 * modulus, rtol=1e-6)
    np.testing.assert_allclose(by_det, -by_trace / det**2, rtol=1e-6)


@wp.func
def ogden_slopes(trace: float, det: float, spread: float, ogden_moduli: wp.vec3, ogden_exponents: wp.vec3):
    by_trace, by_det = ogden(trace, det, spread, ogden_moduli, ogden_exponents)
    return wp.vec3(by_trace, by_det, 0.0)


@pytest.mark.parametrize("exponents", [OGDEN[1], (0.0, 10.0, -10.0), (1.0, 2.0, 1e-3)])
def test_slopes_of_an_ogden_material_keep_their_digits(exponents: tuple[float, ...]):
    """Derivatives of an Ogden material keep float32's digits for equal, nearly equal and different stretches."""
    rounded = 1e-6 + 3e-7 * max(np.abs(exponents))
    random = np.random.default_rng(2)
    det = random.uniform(0.5, 100.0, COUNT).astype(np.float32)
    beside = np.linspace(0.05, 0.17, 16)  # where series end
    apart = np.concatenate([np.zeros(4), beside, np.geomspace(1e-4, 4.0, COUNT - 20)])  # log of l1 / l2
    spread = (2.0 * np.sqrt(det) * np.sinh(apart)).astype(np.float32)
    g = np.sqrt(det.astype(np.float64))
    t = np.maximum(np.arcsinh(0.5 * spread / g), 1e-9)
    samples = {"trace": 2.0 * g * np.cosh(t), "det": det, "spread": spread}
    moduli = np.array([6.3e5, 1.2e3, 1e4])
    for name, numbers in (("ogden_moduli", moduli), ("ogden_exponents", np.array(exponents))):
        samples[name] = np.tile(numbers, (COUNT, 1))
    samples = {name: np.ascontiguousarray(values, dtype=np.float32) for name, values in samples.items()}
    by_trace, by_det, _ = called(ogden_slopes, samples, "vec3").T
    k = 0.5 * np.array(exponents)[:, None]
    parts = 0.5 * moduli[:, None] * g ** (k - 1.0) * np.sinh(k * t) / np.sinh(t)
    grown = 0.5 * moduli[:, None] * g**k * np.cosh(k * t)
    expected = parts.sum(axis=0)
    assert (np.abs(by_trace - expected) < rounded * np.abs(parts).sum(axis=0)).all()
    shrunk = 0.5 * moduli[:, None] * g ** (-2.0 * k)
    other = ((grown - shrunk).sum(axis=0) - expected * g * np.cosh(t)) / g**2
    size = ((grown + shrunk).sum(axis=0) + np.abs(parts).sum(axis=0) * g * np.cosh(t)) / g**2
    assert (np.abs(by_det - other) < rounded * size).all()


def test_powers_are_those_of_the_library():
    random = np.random.default_rng(3)
    samples = {"base": 10.0 ** random.uniform(-6.0, 6.0, COUNT), "exponent": random.uniform(-6.0, 6.0, COUNT)}
    samples["base"][:2] = 1.0, 1.0 + 1e-6
    samples = {name: values.astype(np.float32) for name, values in samples.items()}
    expected = samples["base"].astype(np.float64) ** samples["exponent"].astype(np.float64)
    found = called(power, samples)
    assert (np.abs(found / expected - 1.0) < 3e-7 + 6e-8 * np.abs(np.log2(expected))).all()
    assert found[0] == 1.0  # a triangle at rest bears nothing
    slopes = adjoint(power, samples, np.ones(COUNT, dtype=np.float32), "float32")
    np.testing.assert_allclose(slopes["base"], samples["exponent"] * expected / samples["base"], rtol=1e-5)
    np.testing.assert_allclose(slopes["exponent"], expected * np.log(samples["base"]), rtol=1e-5)


def deformed(points: NDArray, seed: int, least: float) -> NDArray:
    """Return points stretched two and a half times one way and down to so much another, and shaken."""
    random = np.random.default_rng(seed)
    turn, _ = np.linalg.qr(random.normal(size=(3, 3)))
    grown = points @ (turn * (2.5, 1.2, least)) @ turn.T
    return grown + 0.03 * np.ptp(points) * random.normal(size=points.shape)


def forces_at(mesh: PolygonMesh, points: Any, device: str, wrinkling: Any = (1.0,)) -> list[NDArray[np.float64]]:
    """Return the forces of threads of particles, and of triangles [N], shape (worlds, laws, vertices, 3).

    Args:
        points: Places of a balloon of each law in each world, of a shape that broadcasts to that.
        wrinkling: Whether rubber wrinkles, by world."""
    balloons = [scene_of(kind, mesh).balloon[0] for kind in MEMBRANES]
    vary = {f"balloon.{number}.material.wrinkling": list(wrinkling) for number in range(len(balloons))}
    model = build_model(Scene(balloon=balloons, gravity=0.0, touch=False), device, len(wrinkling), vary)
    state, shape = initial_state(model), (len(wrinkling), len(balloons), len(mesh.points), 3)
    places = np.broadcast_to(points, shape).reshape(len(wrinkling), -1, 3)
    wp.copy(state.points, wp.array(places, dtype=wp.vec3, device=device))
    scatter, reader = ScatterSchedule(model), ForceReader(model)
    scatter.sum_forces(state)
    reader.refresh(state)
    found = reader.net_forces(state), scatter.forces
    return [forces.numpy().astype(np.float64).reshape(shape) for forces in found]


@pytest.mark.full  # by default the reference's forces, the slopes of its energies, hold those of the set of rubber
@pytest.mark.parametrize("shape", ["quads", "triangles"])
def test_forces_are_the_slopes_of_the_energy(shape: str, device: str):
    """Forces of balloons of all laws, with wrinkles and without, agree with central differences of the textbooks'
    energies, where float32 rounds C by some 1e-6."""
    mesh = quad_sphere(2) if shape == "quads" else halved(quad_sphere(2))
    faces = mesh.face_vertex_indices.reshape(mesh.face_count, -1)
    points = [deformed(mesh.points, 3, least).astype(np.float32).astype(np.float64) for least in (0.8, 0.35)]
    found, h = forces_at(mesh, np.array(points)[:, None], device, (0.0, 1.0)), 1e-5
    for law, kind in enumerate(MEMBRANES):
        bare = ENERGIES[kind]
        for wrinkles, energy in enumerate((bare, lambda a, b, bare=bare: relaxed(bare, a, b))):
            expected = np.zeros_like(points[wrinkles])
            for particle, axis in np.ndindex(expected.shape):
                aside = np.zeros_like(expected)
                aside[particle, axis] = h
                sides = (points[wrinkles] + aside, points[wrinkles] - aside)
                more, less = (quad_energy(energy, mesh.points, each, faces) for each in sides)
                expected[particle, axis] = -2.0e-4 * (more - less) / (2.0 * h)
            for forces in found:
                np.testing.assert_allclose(forces[wrinkles, law], expected, atol=3e-4 * np.abs(expected).max())


@pytest.mark.full
def test_what_is_slack_has_no_forces_and_wrinkles_none_across(device: str):
    square = mesh_of([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)], [[0, 1, 2, 3]])
    slack, wrinkled, narrower = ((0.9, 0.5, 1.0), (2.0, 0.5, 1.0), (2.0, 0.3, 1.0))
    points = square.points * np.array([slack, wrinkled, narrower])[:, None]
    for forces in forces_at(square, points[:, None], device, (1.0, 1.0, 1.0)):
        for kind, at in zip(MEMBRANES, forces.swapaxes(0, 1), strict=True):
            size = np.abs(at[1]).max()
            assert size > 1.0
            assert np.abs(at[0]).max() == 0.0
            np.testing.assert_allclose(at[1][:, 1:], 0.0, atol=1e-6 * size)
            np.testing.assert_allclose(at[1], at[2], atol=1e-5 * size)
            # tension over the width at rest, as in a bar: dW/dl at (l, 1 / root l)
            pull = derivative(lambda stretch, kind=kind: ENERGIES[kind](stretch, stretch**-0.5), 2.0, h=1e-5)
            np.testing.assert_allclose(at[1][1, 0] + at[1][2, 0], -2.0e-4 * pull, rtol=1e-4)


@pytest.mark.parametrize("corners", [3, 4, 5, 7, 12, 200])
def test_triangles_cover_a_face_once_whatever_its_corners(corners: int):
    mesh = polygon(corners)
    membrane = build_membrane(mesh)
    area = 0.5 * corners * np.sin(2.0 * np.pi / corners)
    assert membrane.areas.sum() == pytest.approx(area, rel=1e-9)
    if corners <= 6:  # no corner is preferred
        np.testing.assert_allclose(membrane.lumped_areas(corners), area / corners, rtol=1e-9)


@pytest.mark.full
def test_a_polygon_is_as_stiff_as_the_same_of_quads(device: str):
    """A polygon has the energy of quads per area in equibiaxial stretch, and so the same sum of forces times places."""
    for mesh in (polygon(6), polygon(5), polygon(40)):
        points = 1.7 * mesh.points
        area = build_membrane(mesh).areas.sum()
        slopes = [derivative(lambda a, energy=energy: energy(a, a), 1.7, h=1e-6) for energy in ENERGIES.values()]
        for forces in forces_at(mesh, points, device):
            work = -(forces[0] * points).sum(axis=(1, 2))
            np.testing.assert_allclose(work, 2.0e-4 * area * 1.7 * np.array(slopes), rtol=1e-4)


@pytest.mark.parametrize("wrinkling", [True, False])
@each_law
def test_no_state_is_stiffer_than_the_bound(kind: str, wrinkling: bool):
    """The stiffness is within the bound, and near it: the second derivative by gradients of rank one, of waves in any
    direction, by differences of the textbook's energy, in taut states up to the most stretch."""
    told = told_of(kind) | {"wrinkling": np.full((1, 1), float(wrinkling))}
    (bound,) = stiffest_modulus(MEMBRANES[kind], told)
    random, energy, h = np.random.default_rng(2), ENERGIES[kind], 1e-4
    first = random.uniform(1.0 if wrinkling else 0.8, told["most_stretch"].item(), 4000)
    first[:500] = random.uniform(0.8, 1.1, 500) if not wrinkling else random.uniform(1.0, 1.1, 500)
    lowest = np.maximum(first**-0.5 if wrinkling else 0.8, first / 3.0)
    second = random.uniform(np.minimum(lowest, first), first)
    first[500:1000] = told["most_stretch"].item()  # where chains lock
    second[500:1000] = random.uniform(0.99, 1.0, 500) * first[500:1000]
    angles = random.uniform(0.0, 2.0 * np.pi, (3, len(first)))
    wave = np.stack([np.cos(angles[0]), np.sin(angles[0])], axis=1)
    way = np.stack([np.cos(angles[1]) * np.cos(angles[2]), np.sin(angles[1]) * np.cos(angles[2]), np.sin(angles[2])], 1)
    still = np.zeros((len(first), 3, 2))
    still[:, 0, 0], still[:, 1, 1] = first, second

    def energy_of(gradient: NDArray) -> NDArray:
        a, b = np.linalg.svd(gradient, compute_uv=False).T
        return energy(a, b)

    step = h * way[:, :, None] * wave[:, None, :]
    stiffness = (energy_of(still + step) - 2.0 * energy_of(still) + energy_of(still - step)) / h**2
    assert stiffness.max() <= 1.01 * bound
    assert stiffness.max() >= 0.7 * bound


ENERGIES_OF_LAWS = dict.fromkeys((law.energy for law in MEMBRANES.values()), "float32")
OTHERS = {neo_hookean_slopes: "vec3", ogden_slopes: "vec3", power: "float32"}
compile_together(ENERGIES_OF_LAWS | OTHERS, wp.get_module("membranes"))


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
    "3x3 grid: four rows and four columns of four particles each": (grid(3, 3), (24, 18, 16)),
    "cube: opposite corners are three edges apart": (cube(), (12, 12, 0)),
    "pentagonal prism: 2 x 5 diagonals of pentagons, 5 x 2 of quads": (prism(5), (15, 20, 0)),
    "two quads at one vertex: two neighbors on either side of it": (two_quads(), (8, 4, 4)),
    "Moebius strip of 7: 7 rungs and a border of 14 edges, flexion along the border": (moebius(7), (21, 14, 14)),
    "a vertex of valence 6 amid triangles: three opposite pairs and six of every second": (
        mesh_of([[0, 0, 0], *polygon(6).points], [[0, i, i % 6 + 1] for i in range(1, 7)]),
        (12, 0, 9),
    ),
    "torus of 4 around: opposite particles have two between them, and one spring": (torus(4, 5), (40, 40, 2 * 5 + 20)),
    "a diagonal that is an edge": (mesh_of(np.eye(4, 3), [[0, 1, 2, 3], [0, 1, 2]]), (5, 1, 0)),
    # 6 n^2 quads have 12 n^2 edges and 12 n^2 diagonals. Two neighbors of a particle of valence 4 that share no quad
    # are opposite to each other: two pairs around each of the 6 n^2 + 2 particles but the 8 corners, of valence 3.
    **{f"quad sphere {n}": (quad_sphere(n), (12 * n**2, 12 * n**2, 12 * n**2 - 12)) for n in (1, 3, 16)},
}


@pytest.mark.parametrize("case", HAND_COUNTS)
def test_hand_counts(case: str) -> None:
    mesh, expected = HAND_COUNTS[case]
    springs = build_springs(mesh)
    assert (springs.structural_count, springs.shear_count, springs.flexion_count) == expected


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


def test_order_and_rest_lengths() -> None:
    springs = build_springs(cube())
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


@pytest.mark.parametrize("size", [1e-3, 1.0, 1e3])
@pytest.mark.parametrize(("height", "count"), [(2.5e-6, 1), (1.5e-6, 0)])
def test_a_triangle_is_as_narrow_as_a_line_at_any_size(height: float, count: int, size: float):
    """Half of base times height is compared with a millionth of the longest side squared."""
    needle = mesh_of(size * np.array([(0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.5, height, 0.0)]), [[0, 1, 2]])
    assert len(build_membrane(needle).areas) == count
