"""Pinned particles, by number, by a group of the mesh, by a mask or by a rule."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from meshes import cube, quad_sphere

import balloon_warp as bw
from balloon_warp import Balloon, InputError, Scene
from balloon_warp.mesh.obj import read_obj, write_obj
from balloon_warp.mesh.obj_groups import MOST_GROUPS
from balloon_warp.model.shape import shape_balloon

OBJ = """v 0 0 0
v 1 0 0
v 0 1 0
v 0 0 1
o a thing of two words
g low first
f 1 2 3
g
f 2 3 4
g first
f 1 3 4
o
f 1 2 4
g nobody
"""
USD = """#usda 1.0
def Mesh "corner"
{
    int[] faceVertexCounts = [3, 3]
    int[] faceVertexIndices = [0, 1, 2, 1, 2, 3]
    point3f[] points = [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)]
    def GeomSubset "side"
    {
        uniform token elementType = "face"
        int[] indices = [1, 7]
    }
    def GeomSubset "ends"
    {
        uniform token elementType = "point"
        int[] indices = [3, 0, 9, -1]
    }
    def GeomSubset "edges"
    {
        uniform token elementType = "edge"
        int[] indices = [0, 1]
    }
}
"""


def still(balloon: Balloon) -> list[int]:
    """Return the particles without a share of the mass."""
    return np.flatnonzero(shape_balloon(balloon, Scene(balloon=[balloon])).mass_share == 0.0).tolist()


def test_groups_and_objects_of_an_obj_file_are_known(tmp_path: Path):
    """A group or object has the vertices of the faces that follow, until the next of its kind; not an empty one."""
    (tmp_path / "thing.obj").write_text(OBJ)
    groups = {name: vertices.tolist() for name, vertices in read_obj(tmp_path / "thing.obj").groups.items()}
    assert groups == {"low": [0, 1, 2], "first": [0, 1, 2, 3], "a thing of two words": [0, 1, 2, 3]}
    assert still(Balloon(mesh=tmp_path / "thing.obj", fixed="low")) == [0, 1, 2]
    assert still(Balloon(mesh=tmp_path / "thing.obj", fixed=["low", 3])) == [0, 1, 2, 3]


def test_a_file_of_countless_names_is_read(tmp_path: Path):
    """A file of countless names keeps the first ones."""
    faces = "".join(f"g n{number}\nf 1 2 3\n" for number in range(MOST_GROUPS + 5))
    (tmp_path / "many.obj").write_text(f"v 0 0 0\nv 1 0 0\nv 0 1 0\n{faces}")
    assert list(read_obj(tmp_path / "many.obj").groups) == [f"n{number}" for number in range(MOST_GROUPS)]


def test_subsets_of_usd_are_known(tmp_path: Path):
    """Subsets of faces and of points become groups, without those of other indices."""
    (tmp_path / "corner.usda").write_text(USD)
    groups = {name: vertices.tolist() for name, vertices in bw.load_mesh(tmp_path / "corner.usda").groups.items()}
    assert groups == {"side": [1, 2, 3], "ends": [0, 3]}
    assert still(Balloon(mesh=tmp_path / "corner.usda", fixed="ends")) == [0, 3]


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


def test_what_is_pinned_stays_where_it_is():
    held = replace(cube(), groups={"bottom": np.array([0, 1, 4, 5], dtype=np.int32)})
    found = bw.simulate(Scene(frames=5, balloon=[Balloon(mesh=held, fixed="bottom")]), device="cpu")
    moved = np.abs(found.points[0][-1] - found.points[0][0]).max(axis=1)
    assert (moved[[0, 1, 4, 5]] == 0.0).all()
    assert (moved[[2, 3, 6, 7]] > 0.0).all()


def test_a_pin_that_makes_no_sense_is_told():
    named = replace(cube(), name="box", groups={"top": np.array([2], dtype=np.int32)})
    with pytest.raises(InputError, match=r"^fixed: box has no group tip; it has top$"):
        shape_balloon(Balloon(mesh=named, fixed="tip"), Scene(balloon=[Balloon(mesh=named)]))
    with pytest.raises(
        InputError, match=r"^balloon\.fixed: the function must return a boolean for each point, of shape"
    ):
        Balloon(mesh=named, fixed=lambda points: points[:, 1])
    with pytest.raises(InputError, match=r"^balloon\.fixed: none\.obj: no such file$"):
        Balloon(mesh="none.obj", fixed=lambda points: points[:, 1] > 0.0)
    with pytest.raises(InputError, match=r"^balloon\.fixed\.0: must be greater than or equal to 0 or a valid string"):
        Balloon(mesh=named, fixed=[-1])
