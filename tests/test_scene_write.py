"""Scenes as files of one's own: they equal the scene, with its meshes, and document each field."""

import re
import shutil
import tomllib
from pathlib import Path

import pytest
from meshes import quad_sphere

from balloon_warp import InputError, Scene, bundled_scenes, load_scene
from balloon_warp.mesh.obj import write_obj
from balloon_warp.scene import Balloon, Sphere
from balloon_warp.scene.reference import as_markdown, tables
from balloon_warp.scene.schema import MESHED
from balloon_warp.scene.schema.field_help import first_line
from balloon_warp.scene.write import scene_toml, write_scene

PAGE = Path(__file__).parent.parent / "docs" / "SCENE.md"


def without_meshes(scene: Scene) -> Scene:
    tables = {
        name: [table.model_copy(update={"mesh": table.mesh and Path()}) for table in getattr(scene, name)]
        for name in MESHED
    }
    tables["balloon"] = [table.model_copy(update={"print": table.print and Path()}) for table in tables["balloon"]]
    materials = [table.material for table in tables["balloon"]]
    materials = [each.model_copy(update={"rest_mesh": each.rest_mesh and Path()}) for each in materials]
    pairs = zip(tables["balloon"], materials, strict=True)
    tables["balloon"] = [table.model_copy(update={"material": material}) for table, material in pairs]
    return scene.model_copy(update=tables)


def mesh_files(scene: Scene) -> list[Path]:
    return [Path(str(table.mesh)) for name in MESHED for table in getattr(scene, name) if table.mesh]


@pytest.mark.parametrize("name", bundled_scenes())
def test_a_bundled_scene_is_written_with_its_meshes_and_can_be_moved(tmp_path: Path, name: str):
    (tmp_path / "here").mkdir()
    scene = load_scene(name)
    written = write_scene(scene, tmp_path / "here" / "mine.toml")
    assert sorted(written) == sorted((tmp_path / "here").iterdir())
    moved = load_scene(shutil.move(tmp_path / "here", tmp_path / "there") / "mine.toml")
    assert without_meshes(moved) == without_meshes(scene)
    for mesh, own in zip(mesh_files(moved), mesh_files(scene), strict=True):
        assert mesh.parent == tmp_path / "there"
        assert mesh.read_bytes() == own.read_bytes()
    printed = tmp_path / "printed.toml"
    printed.write_text(scene_toml(scene, tmp_path))
    assert load_scene(printed) == scene


def test_a_copy_of_the_mesh_stays_and_another_file_is_not_replaced(tmp_path: Path):
    path = tmp_path / "mine.toml"
    assert write_scene(load_scene("helium_rise"), path) == [path, tmp_path / "ball.obj"]
    assert write_scene(load_scene("helium_rise"), path) == [path]
    before = path.read_bytes()
    (tmp_path / "ball.obj").write_text("of my own")
    with pytest.raises(
        InputError, match=r"/ball\.obj: already exists and differs from the scene's file of that name; "
    ):
        write_scene(load_scene("two_balloons"), path)
    assert (path.read_bytes(), (tmp_path / "ball.obj").read_text()) == (before, "of my own")


def test_a_mesh_of_ones_own_is_named_from_the_file(tmp_path: Path):
    """A mesh of one's own is named by its path from the file, however the folder is reached."""
    for folder in ("meshes", "scenes/real"):
        (tmp_path / folder).mkdir(parents=True)
    (tmp_path / "link").symlink_to(tmp_path / "scenes" / "real")
    write_obj(tmp_path / "meshes" / "ball.obj", quad_sphere(2))
    path = tmp_path / "link" / "mine.toml"
    write_scene(load_scene(tmp_path / "meshes" / "ball.obj"), path)
    assert tomllib.loads(path.read_text())["balloon"][0]["mesh"] == "../../meshes/ball.obj"
    assert Path(str(load_scene(path).balloon[0].mesh)).exists()


def test_each_value_has_its_unit_and_default_beside_it():
    scene = Scene(
        substeps=20,
        solver="forward_euler",
        balloon=[Balloon(mesh="a.obj", mass=0.2, law={"magnet": {"strength": 5.0}})],
        sphere=[Sphere(position=(0.0, 1.0, 0.0), mass=3.0)],
    )
    text = scene_toml(scene, Path())
    lines = [re.sub(" +# ", "  # ", line) for line in text.splitlines()]
    assert "mass = 0.2  # Mass of the whole balloon, shared equally by its particles [kg]; default 0.1" in lines
    assert "position = [0.0, 1.0, 0.0]  # Position of the center at the start [m]" in lines
    assert "mass = 3.0                  # Mass [kg]; default 1.0\n" in text  # beneath the other comment
    assert "[[sphere]]  # A rigid sphere that collides with balloons, spheres, obstacles and the ground." in lines
    above = lines[: lines.index('solver = "forward_euler"')]
    assert above[-1].endswith('"symplectic_euler"')  # too long to stand beside it
    assert above[-3].startswith("# Time integrator: ")
    assert "law = { magnet = { strength = 5.0 } }" in text


def test_the_tables_in_the_docs_are_what_the_schema_says():
    (tables,) = re.findall(r"<!-- fields -->\n\n(.*?)\n\n<!-- end -->", PAGE.read_text(encoding="utf-8"), re.DOTALL)
    assert tables == as_markdown(), "python -m balloon_warp.scene.reference makes them anew"


def test_every_field_of_a_scene_says_what_it_is():
    """Every field of a scene has a description, shared fields included."""
    rows = [line.strip("| ").split(" | ") for line in as_markdown().splitlines() if line.startswith("| `")]
    assert len(rows) > 150
    assert [row[0] for row in rows if len(row) < 4 or not row[1].strip()] == []


def test_what_a_table_is_fits_into_its_first_line():
    """The first line of a table's description is short enough for a row of SCENE.md and a scene file."""
    assert [heading for heading, table in tables() if table.__doc__ and not first_line(table).endswith(".")] == []


def test_every_default_of_a_scene_stands_in_them():
    """Every default is printed, unless it is a table, nothing, or empty."""
    cells = [[cell.strip(" |") for cell in row.split(" | ")] for row in as_markdown().splitlines()]
    rows = {(row[0], *row[2:]) for row in cells if len(row) == 4}
    assert ("`gravity`", "number", "`9.81`") in rows
    assert ("`mesh`", "file", "required") in rows
    assert ("`molar_mass`", "number ≥ 0", "`0.0040026`") in rows
    assert ("`particle`", 'whole number ≥ 0 or `"highest"` or `"lowest"`', '`"lowest"`') in rows
    assert ("`color`", "3 numbers from 0 to 1", "-") in rows
    assert ("`restitution`", "number from 0 to 1", "`0.3`") in rows
