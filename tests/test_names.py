"""Names in any script, in a stage and in its exports."""

import unicodedata
from pathlib import Path

import pytest
from glb_files import Glb
from meshes import cube
from motion import animated
from pxr import Sdf, Usd, UsdGeom

from balloon_warp import (
    Balloon,
    Body,
    Ground,
    Obstacle,
    Scene,
    animate,
    export_stage,
    load_scene,
    render_stage,
    run_batch,
)
from balloon_warp.mesh.obj import write_obj
from balloon_warp.usd.material import identifier

SCRIPTS = ["気球", "шар", "μπαλόνι", "גליל", "गुब्बारा", "풍선", "Ballon_rouge_é", "ßÆ", "_x1"]
HALVES = unicodedata.normalize("NFC", "é"), unicodedata.normalize("NFD", "é")


def scene(*names: str) -> Scene:
    """Return a scene with a balloon of each name, side by side."""
    balloons = [Balloon(mesh=cube(), name=name, position=(3.0 * n, 0, 0)) for n, name in enumerate(names)]
    return Scene(balloon=balloons, frames=1, touch=False)


def meshes_of(stage: Usd.Stage) -> list[Usd.Prim]:
    return [prim for prim in stage.GetDefaultPrim().GetChildren() if prim.IsA(UsdGeom.Mesh)]


@pytest.mark.parametrize(
    ("name", "kept"),
    [
        *((name, name) for name in SCRIPTS),
        ("Ballon rouge é", "Ballon_rouge_é"),
        ("気球 2", "気球_2"),
        ("2気球", "_気球"),
        ("a-b.c", "a_b_c"),
        ("шар🎈", "шар_"),
        ("\u0301e", "_e"),
        ("\udce9t", "_t"),
        ("🎈", "_"),
        ("", "_"),
    ],
)
def test_a_name_that_usd_takes_stays_and_else_only_what_it_does_not_is_replaced(name: str, kept: str):
    assert identifier(name) == kept
    assert Sdf.Path.IsValidIdentifier(kept)


@pytest.mark.full
@pytest.mark.parametrize("suffix", [".usda", ".usdc"])
def test_balloons_obstacles_and_bodies_are_called_as_they_are(suffix: str, tmp_path: Path):
    things = {"obstacle": [Obstacle(shape="box", name="стена 1", position=(0, -5, 0))]}
    things |= {"body": [Body(shape="box", name="箱", position=(0, 50, 0), mass=1.0)]}
    stage = animated(scene(*SCRIPTS, "Ballon rouge é").model_copy(update=things), tmp_path / f"s{suffix}")
    assert [prim.GetName() for prim in meshes_of(stage)] == [*SCRIPTS, "Ballon_rouge_é_1"]
    assert [prim.GetDisplayName() for prim in meshes_of(stage)] == [""] * len(SCRIPTS) + ["Ballon rouge é"]
    assert stage.GetPrimAtPath("/World/Obstacles/стена_1").GetDisplayName() == "стена 1"
    assert stage.GetPrimAtPath("/World/Bodies/箱").GetDisplayName() == ""


def test_names_that_look_the_same_get_numbers(tmp_path: Path):
    composed, decomposed = HALVES
    named = scene(composed, decomposed, composed, f"{decomposed}_1", "Ground").model_copy(update={"ground": Ground()})
    stage = animated(named, tmp_path / "same.usda")
    prims = meshes_of(stage)
    names = [prim.GetName() for prim in prims]
    assert names == ["é", "é_1", "é_2", "é_1_1", "Ground_1", "Ground"]
    assert all(name == unicodedata.normalize("NFC", name) for name in names)
    assert [prim.GetDisplayName() for prim in prims] == ["", "é", "é", "é_1", "Ground", ""]


@pytest.mark.parametrize("name", ["気球", "Ballon rouge é"])
def test_a_file_s_name_stays(name: str, tmp_path: Path):
    write_obj(tmp_path / f"{name}.obj", cube())
    stage = animated(load_scene(tmp_path / f"{name}.obj", {"frames": 1}), tmp_path / "out.usdc")
    prim = meshes_of(stage)[0]
    assert prim.GetName() == identifier(name)
    assert (prim.GetDisplayName() or prim.GetName()) == name


@pytest.mark.full
def test_the_worlds_of_a_batch_have_the_names(tmp_path: Path):
    named = scene("気球", "Ballon rouge é").model_copy(update={"obstacle": [Obstacle(shape="box", name="стена 1")]})
    named = named.model_copy(update={"obstacle": [named.obstacle[0].model_copy(update={"position": (0, -9, 0)})]})
    run_batch(named, tmp_path / "batch", 2, {"gravity": [1.0, 2.0]}, export=[0, 1], device="cpu")
    stage = Usd.Stage.Open(str(tmp_path / "batch" / "worlds.usdc"))
    for world in ("World_0", "World_1"):
        assert stage.GetPrimAtPath(f"/World/{world}/気球").GetDisplayName() == ""
        assert stage.GetPrimAtPath(f"/World/{world}/Ballon_rouge_é").GetDisplayName() == "Ballon rouge é"
        assert stage.GetPrimAtPath(f"/World/{world}/стена_1").GetDisplayName() == "стена 1"


@pytest.fixture(scope="module")
def stage(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("stage") / "気球.usdc"
    animate(scene("気球", "Ballon rouge é"), path, device="cpu")
    return path


@pytest.mark.parametrize("suffix", [".glb", ".obj", ".usdz", ".pvd", ".h5", ".ply"])
def test_what_is_made_of_a_stage_has_the_names(suffix: str, stage: Path, tmp_path: Path):
    output = tmp_path / (f"шар.####{suffix}" if suffix in (".obj", ".ply") else f"шар{suffix}")
    export_stage(stage, output)
    files = [path for path in tmp_path.iterdir() if path.stat().st_size]
    assert all(path.name.startswith("шар") for path in files)
    if suffix == ".glb":
        assert {"気球", "Ballon_rouge_é"} <= Glb(output).nodes.keys()
    if suffix == ".obj":
        assert "o 気球\n" in files[0].read_text(encoding="utf-8")


@pytest.mark.parametrize("named", ["気球", "Ballon_rouge_é", "Ballon rouge é", f"Ballon rouge {HALVES[1]}"])
def test_a_picture_looks_at_either_name(named: str, stage: Path, tmp_path: Path):
    render_stage(stage, tmp_path / "picture.png", 1, (64, 64), 1, "cpu", look_at=named)
    assert (tmp_path / "picture.png").stat().st_size > 0
