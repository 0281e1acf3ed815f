"""Balloon of some of a mesh's parts."""

import json
from pathlib import Path

import numpy as np
import pytest
from meshes import cube, joined, open_cube, quad_sphere
from odd_things import car, hair, haired
from typer.testing import CliRunner

from balloon_warp.cli.app import app
from balloon_warp.errors import InputError
from balloon_warp.mesh import PolygonMesh
from balloon_warp.mesh.obj import write_obj
from balloon_warp.mesh.prepare import Treatment, prepared
from balloon_warp.model.shape import shape_balloon
from balloon_warp.scene import Balloon, Scene, load_scene


def taken(mesh: PolygonMesh, which: str) -> PolygonMesh:
    return prepared(mesh, "mesh", Treatment(taken=which))


def test_hair_is_left_out() -> None:
    """Hair is left out, with one count of the parts in the message, and vertices keep their numbers."""
    bald = taken(haired(), "closed")
    assert bald.vertex_count == haired().vertex_count
    assert bald.face_count == quad_sphere(12).face_count
    assert bald.warnings == ("60 of 61 parts, of 600 faces, are left out: they are open.",)


def test_the_largest_is_by_area() -> None:
    mesh = joined(open_cube(), quad_sphere(4, 0.2))
    assert taken(mesh, "largest").face_count == 5
    assert taken(mesh, "closed").face_count == quad_sphere(4).face_count
    assert taken(mesh, "all").face_count == 5 + quad_sphere(4).face_count
    assert taken(cube(), "largest").warnings == ()


def test_a_mesh_without_a_closed_part_is_refused() -> None:
    with pytest.raises(
        InputError, match='has no closed part, all of its 20 parts are open; expected parts = "all" or "larg'
    ):
        taken(hair(20), "closed")


def test_what_is_left_out_has_no_mass_and_no_springs() -> None:
    balloon = Balloon(mesh=haired(), taken="closed")
    shape = shape_balloon(balloon, Scene(balloon=[balloon]))
    head = quad_sphere(12).vertex_count
    assert not shape.mass_share[head:].any()
    assert shape.springs.pairs.max() < head
    assert shape.closed
    assert not shape.slack.any()
    assert not load_scene(haired(), {"balloon.taken": "closed"}).balloon[0].fixed


@pytest.mark.parametrize("words", [["inspect", "--json"], ["scenes"]])
def test_commands_take_parts(words: list[str], tmp_path: Path) -> None:
    write_obj(tmp_path / "car.obj", car())
    said = CliRunner().invoke(app, [words[0], str(tmp_path / "car.obj"), *words[1:], "--parts", "closed"])
    assert said.exit_code == 0, said.output
    if words[0] == "inspect":
        assert json.loads(said.stdout)["components"] == 29
    else:
        assert 'taken = "closed"' in said.stdout


def test_another_word_is_refused(tmp_path: Path) -> None:
    write_obj(tmp_path / "car.obj", car())
    said = CliRunner().invoke(app, ["run", str(tmp_path / "car.obj"), "--parts", "some"])
    assert isinstance(said.exception, InputError)
    assert str(said.exception) == "--parts some: expected all, closed, largest"


def test_remesh_takes_parts(tmp_path: Path) -> None:
    write_obj(tmp_path / "head.obj", haired())
    words = ["remesh", str(tmp_path / "head.obj"), "-o", str(tmp_path / "out.obj"), "--cells", "16"]
    said = CliRunner().invoke(app, [*words, "--parts", "closed"])
    assert said.exit_code == 0, said.output
    points = np.array([line.split()[1:] for line in (tmp_path / "out.obj").read_text().splitlines() if line[0] == "v"])
    assert np.abs(points.astype(float)).max() < 0.15
