"""Parts of a mesh: which are taken, the springs that join them, and pins at groups and borders."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from commands import lines_executed
from meshes import at, car, cube, grid, hair, haired, joined, mesh_of, open_cube, quad_sphere, tetrahedron
from numpy.typing import NDArray
from trajectories import stepped
from typer.testing import CliRunner, Result

import balloon_warp as bw
from balloon_warp import Balloon, InputError, PolygonMesh, Scene, Simulator, build_springs, load_scene
from balloon_warp.cli.app import app
from balloon_warp.mesh.load import Parts, Treatment, prepared
from balloon_warp.mesh.obj import MOST_GROUPS, read_obj, write_obj
from balloon_warp.mesh.topology import mesh_edges, vertex_components
from balloon_warp.model.shape import shape_balloon
from balloon_warp.scene.around import pinned_at_borders
from balloon_warp.springs import even

BALL = quad_sphere(8)
FINE = quad_sphere(24)
PARTS: dict[str, PolygonMesh] = {
    "cubes, face to face": joined(cube(), at(cube(), (1, 0, 0))),
    "cubes apart": joined(cube(), at(cube(), (3, 0, 0))),
    "cubes far apart": joined(cube(), at(cube(), (30, 20, 10))),
    "balls in a row": joined(BALL, at(BALL, (2.5, 0, 0)), at(BALL, (5, 0, 0)), at(BALL, (7.5, 0, 0))),
    "a fine ball that touches a coarse one at a point": joined(FINE, at(BALL, (0, 0, 1.3), 0.3)),
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
"""where ties are long beside the parts that they hold, or parts hang on one another in a chain"""


@pytest.mark.parametrize("name", PARTS)
def test_ties_are_few_and_hold_parts_against_motion_and_rotation(name: str) -> None:
    mesh = PARTS[name]
    pairs = even.tie_pairs(mesh)
    eigenvalues = stiffness_of_parts(mesh, pairs)
    assert eigenvalues[5] < 1e-9  # all move and turn together
    assert eigenvalues[6] > LEVERS.get(name, 0.1)  # of one spring's constant
    component = vertex_components(mesh, mesh_edges(mesh))
    assert (component[pairs[:, 0]] != component[pairs[:, 1]]).all()
    assert len(np.unique(pairs, axis=0)) == len(pairs)
    # Rounds have half as many parts each: twice as many in all; each with its ties and a brace.
    assert len(pairs) <= 2 * len(np.unique(component)) * (even.TIED * even.EACH + even.BRACED**2)
    for part in np.unique(component):  # each has some with as many ties as they are to have, however far those are
        there = np.flatnonzero(component == part)
        elsewhere = len(mesh.points) - len(there)
        full = np.bincount(pairs.ravel(), minlength=len(mesh.points))[there] >= min(even.EACH, elsewhere)
        assert full.sum() >= min(even.LEAST_TIED, len(there))
    np.testing.assert_array_equal(even.tie_pairs(mesh), pairs)


def test_ties_that_hold_firmly_need_no_brace() -> None:
    """Cubes apart have sixteen, from each of four corners to each of the other's four; braces would be nine more."""
    assert len(even.tie_pairs(PARTS["cubes apart"])) == even.EACH * even.LEAST_TIED


def test_ties_are_structural_springs_at_rest() -> None:
    mesh = PARTS["balls in a row"]
    springs, own = even.balloon_springs(mesh, "held"), build_springs(mesh)
    assert springs.structural_count == own.structural_count + len(even.tie_pairs(mesh))
    assert (springs.shear_count, springs.flexion_count) == (own.shear_count, own.flexion_count)
    rows = np.column_stack([springs.kind, springs.pairs]).tolist()
    assert rows == sorted(rows)
    lengths = np.linalg.norm(np.diff(mesh.points[springs.pairs], axis=1)[:, 0], axis=1)
    np.testing.assert_array_equal(springs.rest_lengths, lengths)
    assert (springs.pairs.dtype, springs.kind.dtype) == (np.int32, np.int32)
    np.testing.assert_array_equal(even.balloon_springs(mesh, "free").pairs, own.pairs)
    assert len(even.tie_pairs(BALL)) == 0
    assert even.balloon_springs(mesh_of(cube().points, [[0, 1], [2, 3]]), "held").count == 2  # a net


@pytest.mark.parametrize("count", [2, 3, 7, 32])
def test_the_nearest_of_another_label_is_found_and_points_are_spread(count: int) -> None:
    points, labels = np.random.default_rng(count).normal(size=(200, 3)), np.arange(200) % count
    nearest, distances = even.nearest_elsewhere(points, labels)
    between = np.linalg.norm(points[:, None] - points, axis=2)
    between[labels[:, None] == labels] = np.inf
    np.testing.assert_array_equal(nearest, between.argmin(axis=1))
    np.testing.assert_allclose(distances, between.min(axis=1), rtol=1e-12)
    assert even.spread(np.arange(9.0)[:, None] * [1.0, 0.0, 0.0], 3).tolist() == [0, 8, 4]
    assert even.spread(np.zeros((5, 3)), 3).tolist() == [0]


def test_no_loop_goes_over_particles() -> None:
    few, many = (joined(ball, at(ball, (2.5, 0, 0))) for ball in (BALL, FINE))
    assert lines_executed(lambda: even.tie_pairs(many)) <= 1.5 * lines_executed(lambda: even.tie_pairs(few))


@pytest.mark.full
@pytest.mark.parametrize("parts", ["held", "free"])
def test_a_ball_hangs_from_one_that_is_fixed_or_falls(parts: str, device: str) -> None:
    """A tied ball of 10 N hangs by some dozen springs of 20 N/m each; a free one falls by 1.2 m in half a second."""
    ball = quad_sphere(2)
    held = {"mass": 1.0, "helium": 0.0, "damping": 0.0, "fixed": list(range(ball.vertex_count))}
    balloon = Balloon(mesh=joined(ball, at(ball, (0, -2.5, 0))), parts=parts, **held)
    simulator = stepped(Simulator(Scene(balloon=[balloon], gravity=9.81), device), 30)
    sunk = -2.5 - simulator.read_frame().points[0][ball.vertex_count :, 1].mean()
    assert sunk > 1.0 if parts == "free" else sunk < 0.2


def taken(mesh: PolygonMesh, which: str) -> PolygonMesh:
    return prepared(mesh, "mesh", Treatment(taken=which))


def test_hair_is_left_out_and_has_no_mass_and_no_springs() -> None:
    bald, head = taken(haired(), "closed"), quad_sphere(12)
    assert (bald.vertex_count, bald.face_count) == (haired().vertex_count, head.face_count)
    assert bald.warnings == ("60 of 61 parts, of 600 faces, are left out: they are open.",)
    balloon = Balloon(mesh=haired(), taken="closed")
    shape = shape_balloon(balloon, Scene(balloon=[balloon]))
    assert not shape.mass_share[head.vertex_count :].any()
    assert shape.springs.pairs.max() < head.vertex_count
    assert shape.closed
    assert not shape.slack.any()
    assert not load_scene(haired(), {"balloon.taken": "closed"}).balloon[0].fixed


def test_the_largest_is_by_area() -> None:
    mesh = joined(open_cube(), quad_sphere(4, 0.2))
    closed = quad_sphere(4).face_count
    assert [taken(mesh, which).face_count for which in ("largest", "closed", "all")] == [5, closed, 5 + closed]
    assert taken(cube(), "largest").warnings == ()
    with pytest.raises(InputError, match="has no closed part, all of its 20 parts are open; expected taken = "):
        taken(hair(20), "closed")


@pytest.mark.full
def test_commands_take_parts(tmp_path: Path) -> None:
    write_obj(tmp_path / "car.obj", car())
    write_obj(tmp_path / "head.obj", haired())

    def said(words: str, parts: str = "closed") -> Result:
        name, mesh, *more = words.split()
        return CliRunner().invoke(app, [name, str(tmp_path / mesh), *more, "--parts", parts])

    assert json.loads(said("inspect car.obj --json").stdout)["components"] == 29
    assert 'taken = "closed"' in said("scenes car.obj").stdout
    assert said(f"remesh head.obj -o {tmp_path}/out.obj --cells 16").exit_code == 0
    points = np.array([line.split()[1:] for line in (tmp_path / "out.obj").read_text().splitlines() if line[0] == "v"])
    assert np.abs(points.astype(float)).max() < 0.15
    refused = said("run car.obj", "some").exception
    assert (type(refused), str(refused)) == (InputError, "--parts some: expected all, closed, largest")


OBJ = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\no a thing of two words\ng low first\nf 1 2 3\ng\nf 2 3 4\ng first\nf 1 3 4\n"
OBJ += "o\nf 1 2 4\ng nobody\n"
SUBSET = """    def GeomSubset "{}"
    {{
        uniform token elementType = "{}"
        int[] indices = {}
    }}
"""
USD = """#usda 1.0
def Mesh "corner"
{
    int[] faceVertexCounts = [3, 3]
    int[] faceVertexIndices = [0, 1, 2, 1, 2, 3]
    point3f[] points = [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)]
"""
USD += SUBSET.format("side", "face", [1, 7]) + SUBSET.format("ends", "point", [3, 0, 9, -1])
USD += SUBSET.format("edges", "edge", [0, 1]) + "}\n"


def still(balloon: Balloon) -> list[int]:
    """Return the particles without a share of the mass."""
    return np.flatnonzero(shape_balloon(balloon, Scene(balloon=[balloon])).mass_share == 0.0).tolist()


GROUPS = {
    "thing.obj": (OBJ, {"low": [0, 1, 2], "first": [0, 1, 2, 3], "a thing of two words": [0, 1, 2, 3]}, "low"),
    "corner.usda": (USD, {"side": [1, 2, 3], "ends": [0, 3]}, "ends"),
}


@pytest.mark.parametrize("name", GROUPS)
def test_groups_of_a_file_are_known(name: str, tmp_path: Path):
    """A group or object of an OBJ file has the vertices of the faces that follow, until the next of its kind; not an
    empty one. Of USD, subsets of faces and of points become groups, without those of other indices."""
    text, expected, fixed = GROUPS[name]
    (tmp_path / name).write_text(text)
    groups = {group: vertices.tolist() for group, vertices in bw.load_mesh(tmp_path / name).groups.items()}
    assert groups == expected
    assert still(Balloon(mesh=tmp_path / name, fixed=fixed)) == expected[fixed]
    assert still(Balloon(mesh=tmp_path / name, fixed=[fixed, 3])) == sorted({*expected[fixed], 3})


def test_a_file_of_countless_names_keeps_the_first(tmp_path: Path):
    faces = "".join(f"g n{number}\nf 1 2 3\n" for number in range(MOST_GROUPS + 5))
    (tmp_path / "many.obj").write_text(f"v 0 0 0\nv 1 0 0\nv 0 1 0\n{faces}")
    assert list(read_obj(tmp_path / "many.obj").groups) == [f"n{number}" for number in range(MOST_GROUPS)]


def test_a_rule_holds_for_the_mesh_s_own_points(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """A rule sees the mesh's own points, wherever the balloon is placed, and a scene file has the resulting numbers."""
    ball = quad_sphere(3)
    balloon = Balloon(mesh=ball, position=(0, 50, 0), rotation=(90, 0, 0), fixed=lambda points: points[:, 1] > 0.5)
    assert balloon.fixed == np.flatnonzero(ball.points[:, 1] > 0.5).tolist() == still(balloon)
    assert Balloon(mesh=ball, fixed=ball.points[:, 1] > 0.5).fixed == balloon.fixed
    assert Balloon(mesh=ball, fixed=np.array([4, 2])).fixed == [4, 2]
    write_obj(tmp_path / "ball.obj", ball)
    (tmp_path / "mine.toml").write_text('[[balloon]]\nmesh = "ball.obj"\n')
    rule = {"balloon.fixed": lambda points: points[:, 1] > 0.5}
    for source in ("ball.obj", "mine.toml"):  # also where it is not found from here
        monkeypatch.chdir(tmp_path.parent)
        assert bw.load_scene(tmp_path / source, rule).balloon[0].fixed == balloon.fixed


def test_a_pin_that_makes_no_sense_is_told():
    named = replace(cube(), name="box", groups={"top": np.array([2], dtype=np.int32)})
    for mesh, fixed, sentence in (
        (named, "tip", r"^fixed: box has no group tip; it has top$"),
        (named, lambda points: points[:, 1], r"^balloon\.fixed: the function must return a boolean for each point, of"),
        ("none.obj", lambda points: points[:, 1] > 0.0, r"^balloon\.fixed: none\.obj: no such file$"),
        (named, [-1], r"^balloon\.fixed\.0: must be greater than or equal to 0 or a valid string"),
    ):
        with pytest.raises(InputError, match=sentence):
            shape_balloon(Balloon(mesh=mesh, fixed=fixed), Scene(balloon=[Balloon(mesh=mesh)]))


RIM = {1, 3, 5, 7}
"""of the open cube, whose other four vertices are not on its border"""


LASH, SMALL = at(grid(1, 1), (0, 0, 1.1), 0.2), at(cube(), (3, 0, 0), 0.2)


@pytest.mark.parametrize(
    ("parts", "held", "expected"),
    [
        ([open_cube()], "held", RIM),
        ([cube()], "held", set()),
        # A lash does not pin a closed head at its border; but a body that is mostly open pins the head.
        ([cube(), LASH], "held", set()),
        ([open_cube(), SMALL], "held", RIM),
        # Pins of free parts are all or none: a car's open body would stay where it is while its wheels fall.
        ([open_cube(), SMALL], "free", set()),
        ([open_cube(), at(open_cube(), (3, 0, 0), 0.2)], "free", RIM | {vertex + 8 for vertex in RIM}),
        # Each strip of hair is pinned at its first face by itself: none swings from another.
        (
            [at(grid(3, 1), (0, 2.0 * n, 0)) for n in range(3)],
            "held",
            {8 * n + c for n in range(3) for c in (0, 1, 4, 5)},
        ),
    ],
)
def test_a_mesh_by_itself_is_pinned_at_borders(parts: list[PolygonMesh], held: Parts, expected: set[int]) -> None:
    assert set(pinned_at_borders(joined(*parts), held).tolist()) == expected


@pytest.mark.parametrize("override", [(), (("balloon.holes", "keep"),)])
def test_a_mesh_by_itself_is_not_held_at_holes_that_are_closed(override: tuple, tmp_path: Path) -> None:
    ball = quad_sphere(12)
    counts, corners = ball.face_vertex_counts[1:], ball.face_vertex_indices[4:]
    pierced = replace(ball, face_vertex_counts=counts, face_vertex_indices=corners)
    write_obj(tmp_path / "ball.obj", pierced)
    fixed = load_scene(tmp_path / "ball.obj", override).balloon[0].fixed
    assert fixed == (sorted(ball.face_vertex_indices[:4].tolist()) if override else [])
