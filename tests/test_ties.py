"""Springs that join the parts of a mesh, as if each part were rigid, and the resulting motion."""

from dataclasses import replace

import numpy as np
import pytest
from meshes import cube, grid, joined, mesh_of, quad_sphere, tetrahedron
from numpy.typing import NDArray
from work import lines_executed

from balloon_warp.mesh import PolygonMesh
from balloon_warp.mesh.topology import mesh_edges, vertex_components
from balloon_warp.scene import Balloon, Scene
from balloon_warp.simulator import Simulator
from balloon_warp.springs import build_springs
from balloon_warp.springs.ties import BRACED, EACH, TIED, balloon_springs, nearest_elsewhere, spread, tie_pairs


def at(mesh: PolygonMesh, place: tuple[float, float, float], size: float = 1.0) -> PolygonMesh:
    return replace(mesh, points=mesh.points * size + np.array(place))


BALL = quad_sphere(8)
FINE = quad_sphere(24)
PARTS: dict[str, PolygonMesh] = {
    "cubes, face to face": joined(cube(), at(cube(), (1, 0, 0))),
    "cubes, corner to corner": joined(cube(), at(cube(), (1, 1, 1))),
    "cubes apart": joined(cube(), at(cube(), (3, 0, 0))),
    "cubes far apart": joined(cube(), at(cube(), (30, 20, 10))),
    "balls in a row": joined(BALL, at(BALL, (2.5, 0, 0)), at(BALL, (5, 0, 0)), at(BALL, (7.5, 0, 0))),
    "balls that overlap": joined(BALL, at(BALL, (1.2, 0.3, 0))),
    "a ball in a ball": joined(BALL, at(BALL, (0, 0, 0), 0.5)),
    "a fine ball that touches a coarse one at a point": joined(FINE, at(BALL, (0, 0, 1.3), 0.3)),
    "eyes before a head": joined(FINE, *[at(quad_sphere(3), (x, 0, 1.2), 0.1) for x in (-0.3, 0.3)]),
    "a sheet above a ball": joined(FINE, at(grid(6, 6), (-0.5, 1.05, -0.5), 1.0 / 6.0)),
    "a ball above a tip": joined(at(tetrahedron(), (0, 0, 0), 4.0), at(BALL, (0, 5.5, 0))),
    "rungs between rails": joined(
        *[at(replace(cube(), points=cube().points * [0.1, 5.0, 0.1]), (x, 0, 0)) for x in (0, 1)],
        *[at(replace(cube(), points=cube().points * [0.9, 0.1, 0.1]), (0.1, y, 0)) for y in (1, 2, 3)],
    ),
    "triangles": joined(*[mesh_of(np.eye(3) + n, [[0, 1, 2]]) for n in range(5)]),
}


def stiffness_of_parts(mesh: PolygonMesh, pairs: NDArray[np.int64]) -> NDArray[np.float64]:
    """Return eigenvalues of the ties' stiffness [of one spring] for rigid motion of the parts, with rotation by an
    angle times half the size of the smallest part, in order."""
    labels = np.unique(vertex_components(mesh, mesh_edges(mesh)), return_inverse=True)[1]
    parts = [mesh.points[labels == label] for label in range(labels.max() + 1)]
    arm = 0.5 * min(np.linalg.norm(np.ptp(part, axis=0)) for part in parts)
    rows = np.zeros((len(pairs), len(parts), 6))
    for row, pair in zip(rows, pairs, strict=True):
        way = mesh.points[pair[1]] - mesh.points[pair[0]]
        length = np.linalg.norm(way)
        for sign, particle in zip((-1.0, 1.0), pair, strict=True):
            label = labels[particle]
            offset = (mesh.points[particle] - parts[label].mean(axis=0)) / arm
            if length > 0.0:
                row[label] = sign * np.concatenate([way, np.cross(offset, way)]) / length
    flat = rows.reshape(len(pairs), -1)
    return np.linalg.eigvalsh(flat.T @ flat).astype(np.float64)


LEVERS = {"cubes far apart": 5e-3, "rungs between rails": 5e-3}
"""where ties are long beside what they hold, or parts hang on one another in a chain"""


@pytest.mark.parametrize("name", PARTS)
def test_no_part_moves_nor_turns_against_the_others_without_force(name: str) -> None:
    mesh = PARTS[name]
    pairs = tie_pairs(mesh)
    eigenvalues = stiffness_of_parts(mesh, pairs)
    assert eigenvalues[5] < 1e-9  # all move and turn together
    assert eigenvalues[6] > LEVERS.get(name, 0.1)  # of one spring's constant


@pytest.mark.parametrize("name", PARTS)
def test_ties_are_between_parts_few_and_the_same_each_time(name: str) -> None:
    mesh = PARTS[name]
    pairs = tie_pairs(mesh)
    component = vertex_components(mesh, mesh_edges(mesh))
    count = len(np.unique(component))
    assert (component[pairs[:, 0]] != component[pairs[:, 1]]).all()
    assert len(np.unique(pairs, axis=0)) == len(pairs)
    # Rounds have half as many parts each: twice as many in all; each with its ties and a brace.
    assert len(pairs) <= 2 * count * (TIED * EACH + BRACED**2)
    np.testing.assert_array_equal(tie_pairs(mesh), pairs)


def test_one_part_and_nets_have_no_ties() -> None:
    assert len(tie_pairs(BALL)) == 0
    net = mesh_of(cube().points, [[0, 1], [2, 3]])
    assert balloon_springs(net, "held").count == 2
    pair = PARTS["cubes apart"]
    np.testing.assert_array_equal(balloon_springs(pair, "free").pairs, build_springs(pair).pairs)


def test_ties_are_structural_springs_at_rest() -> None:
    mesh = PARTS["balls in a row"]
    springs, own = balloon_springs(mesh, "held"), build_springs(mesh)
    assert springs.structural_count == own.structural_count + len(tie_pairs(mesh))
    assert (springs.shear_count, springs.flexion_count) == (own.shear_count, own.flexion_count)
    rows = np.column_stack([springs.kind, springs.pairs]).tolist()
    assert rows == sorted(rows)
    lengths = np.linalg.norm(np.diff(mesh.points[springs.pairs], axis=1)[:, 0], axis=1)
    np.testing.assert_array_equal(springs.rest_lengths, lengths)
    assert (springs.pairs.dtype, springs.kind.dtype) == (np.int32, np.int32)


@pytest.mark.parametrize("count", [2, 3, 7, 32])
def test_the_nearest_of_another_label_is_found(count: int) -> None:
    random = np.random.default_rng(count)
    points, labels = random.normal(size=(200, 3)), np.arange(200) % count
    nearest, distances = nearest_elsewhere(points, labels)
    between = np.linalg.norm(points[:, None] - points, axis=2)
    between[labels[:, None] == labels] = np.inf
    np.testing.assert_array_equal(nearest, between.argmin(axis=1))
    np.testing.assert_allclose(distances, between.min(axis=1), rtol=1e-12)


def test_points_are_spread() -> None:
    line = np.arange(9.0)[:, None] * [1.0, 0.0, 0.0]
    assert spread(line, 3).tolist() == [0, 8, 4]
    assert spread(np.zeros((5, 3)), 3).tolist() == [0]


def test_no_loop_goes_over_particles() -> None:
    """Tying two balls of 3,458 particles each executes as many lines of Python as two of 386."""

    def pair(n: int) -> PolygonMesh:
        return joined(quad_sphere(n), at(quad_sphere(n), (2.5, 0, 0)))

    few, many = pair(8), pair(24)
    assert lines_executed(lambda: tie_pairs(many)) <= 1.5 * lines_executed(lambda: tie_pairs(few))


@pytest.mark.parametrize("parts", ["held", "free"])
def test_a_ball_hangs_from_one_that_is_fixed_or_falls(parts: str, device: str) -> None:
    """A tied ball of 10 N hangs by some dozen springs of 20 N/m each; a free one falls by 1.2 m in half a second."""
    ball = quad_sphere(2)
    mesh = joined(ball, at(ball, (0, -2.5, 0)))
    balloon = Balloon(mesh=mesh, parts=parts, mass=1.0, fixed=list(range(ball.vertex_count)))
    balloon = balloon.model_copy(update={"helium": 0.0, "damping": 0.0})
    simulator = Simulator(Scene(balloon=[balloon], gravity=9.81), device)
    for _ in range(30):
        simulator.step()
    sunk = -2.5 - simulator.read_frame().points[0][ball.vertex_count :, 1].mean()
    assert (sunk > 1.0) == (parts == "free")
    assert parts == "free" or sunk < 0.2
