"""Symbolic links: outputs go to their targets, and inputs come from there."""

import os
from collections.abc import Callable
from pathlib import Path

import pytest
from meshes import cube
from painted import write_painted
from pxr import Usd, UsdGeom

from balloon_warp import InputError, animate, export_stage, load_mesh, load_scene, render_stage, run_batch
from balloon_warp.cli.app import app
from balloon_warp.mesh.obj import write_obj
from balloon_warp.scene import Balloon, Scene
from balloon_warp.system.files import whole_file

SCENE = Scene(balloon=[Balloon(mesh=cube(), name="box")], frames=1)
KINDS = ["file", "dangling", "chain", "relative", "folder", "dangling in a folder"]


def link(kind: str, folder: Path, suffix: str) -> tuple[Path, Path]:
    """Return a link of a kind, and its target file in another folder."""
    home, away = folder / "home", folder / "away"
    home.mkdir()
    away.mkdir()
    path, target = home / f"out{suffix}", away / f"real{suffix}"
    if kind in ("file", "chain", "folder"):
        target.write_bytes(b"old")
    if kind == "chain":
        (home / "middle").symlink_to(target)
    if "folder" in kind:
        (home / "linked").symlink_to(away)
        return home / "linked" / target.name, target
    path.symlink_to({"chain": "middle", "relative": f"../away/real{suffix}"}.get(kind, target))
    return path, target


def links_of(folder: Path) -> dict[str, str]:
    return {path.name: str(path.readlink()) for path in folder.rglob("*") if path.is_symlink()}


@pytest.fixture(scope="module")
def stage(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("stage") / "box.usdc"
    animate(SCENE, path, device="cpu")
    return path


WRITERS: dict[str, Callable[[Path, Path], object]] = {
    "run": lambda stage, output: animate(SCENE, output, device="cpu"),
    "export": export_stage,
    "render": lambda stage, output: render_stage(stage, output, 1, (32, 32), 1, "cpu"),
}


@pytest.mark.full
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(
    ("writer", "suffix"), [("run", ".usdc"), ("run", ".usda"), ("run", ".glb"), ("export", ".usdz"), ("render", ".png")]
)
def test_the_target_is_written_and_the_links_stay(writer: str, suffix: str, kind: str, stage: Path, tmp_path: Path):
    path, target = link(kind, tmp_path, suffix)
    before = links_of(tmp_path)
    WRITERS[writer](stage, path)
    assert links_of(tmp_path) == before
    assert not target.is_symlink()
    assert target.stat().st_size > 3
    assert path.read_bytes() == target.read_bytes()
    assert [each for each in tmp_path.rglob("*") if ".partial" in each.name] == []


def test_links_in_a_circle_are_one_sentence(tmp_path: Path):
    one, other = tmp_path / "one.usdc", tmp_path / "other.usdc"
    one.symlink_to(other)
    other.symlink_to(one)
    with pytest.raises(InputError, match=r"^.*one\.usdc: is a circular link; expected .*$"):
        animate(SCENE, one, device="cpu", on_frame=lambda _: pytest.fail("simulates"))
    assert one.is_symlink()
    assert other.is_symlink()


def test_a_device_is_never_replaced_nor_a_folder_made(tmp_path: Path):
    for target, sentence in (
        (os.devnull, f"{os.devnull} is neither a file nor a folder"),
        (tmp_path / "gone" / "real.usdc", r"out\.usdc: the folder .*gone does not exist"),
    ):
        (tmp_path / "out.usdc").unlink(missing_ok=True)
        (tmp_path / "out.usdc").symlink_to(target)
        with pytest.raises(InputError, match=sentence):
            animate(SCENE, tmp_path / "out.usdc", device="cpu")
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(InputError, match="neither"), whole_file(tmp_path / "pipe") as path:
        path.touch()


def test_a_batch_writes_where_its_folder_and_files_lead(tmp_path: Path):
    away, real, names = tmp_path / "away", tmp_path / "real", ("table.csv", "manifest.json", "worlds.usdc")
    away.mkdir()
    (tmp_path / "batch").symlink_to(real)
    run_batch(SCENE, tmp_path / "batch", 2, export=[0], device="cpu")
    assert (tmp_path / "batch").is_symlink()
    for name in names:
        (real / name).rename(away / name)
        (real / name).symlink_to(away / name)
        if name != "manifest.json":  # by which the folder is known as ours
            (away / name).write_bytes(b"old")
    run_batch(SCENE, tmp_path / "batch", 2, export=[0], device="cpu")
    assert set(links_of(tmp_path)) == {"batch", *names}
    assert all((away / name).stat().st_size > 3 for name in names)


def test_checkpoints_are_beside_the_target_and_either_name_finds_them(tmp_path: Path):
    path, target = link("dangling", tmp_path, ".usdc")
    scene = SCENE.model_copy(update={"frames": 4})

    def stop(frame: int) -> None:
        if frame == 3:
            raise RuntimeError("stopped")

    with pytest.raises(RuntimeError):
        animate(scene, path, device="cpu", checkpoint_seconds=1e-9, on_frame=stop)
    assert (tmp_path / "away" / "real.usdc.partial").is_dir()
    assert animate(scene, target, device="cpu", resume=True).begin > 0
    assert [each.name for each in (tmp_path / "away").iterdir()] == ["real.usdc"]


@pytest.mark.parametrize("named", ["link.obj", "folder/real.obj", "link to blob.obj", "scene.toml"])
def test_a_mesh_is_read_through_links_and_called_as_the_link(named: str, tmp_path: Path):
    away = tmp_path / "away"
    away.mkdir()
    write_obj(away / "real.obj", cube())
    (away / "2f3a9c").write_bytes((away / "real.obj").read_bytes())
    (away / "scene.toml").write_text('[[balloon]]\nmesh = "real.obj"\n')
    for name, target in (("link.obj", "real.obj"), ("link to blob.obj", "2f3a9c"), ("scene.toml", "scene.toml")):
        (tmp_path / name).symlink_to(f"away/{target}")
    (tmp_path / "folder").symlink_to("away")
    animate(load_scene(tmp_path / named, {"frames": 1}), tmp_path / "out.usda", device="cpu")
    stage = Usd.Stage.Open(str(tmp_path / "out.usda"))
    mesh = next(prim for prim in stage.Traverse() if prim.IsA(UsdGeom.Mesh))
    assert (mesh.GetDisplayName() or mesh.GetName()) == ("real" if named == "scene.toml" else Path(named).stem)


def test_textures_are_beside_the_link_and_its_target(tmp_path: Path):
    path, target = link("dangling", tmp_path, ".usdc")
    animate(load_scene(write_painted(tmp_path, "obj"), {"frames": 1}), path, device="cpu")
    for place in (path, target):
        render_stage(place, tmp_path / f"{place.stem}.png", 1, (64, 64), 1, "cpu")
        assert [each.suffix for each in (place.parent / "textures").iterdir()] == [".png"]
    assert (tmp_path / "out.png").read_bytes() == (tmp_path / "real.png").read_bytes()


@pytest.mark.parametrize("linked", ["model.obj", "all"])
def test_what_a_mesh_names_is_found_beside_the_link_or_the_file(linked: str, tmp_path: Path):
    away = tmp_path / "away"
    away.mkdir()
    (away / "model.obj").write_text("mtllib m.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl red\nf 1 2 3\n")
    (away / "m.mtl").write_text("newmtl red\nKd 1 0 0\n")
    for name in ("model.obj",) if linked == "model.obj" else ("model.obj", "m.mtl"):
        source = away / name
        if linked == "all":  # a store that calls files by their content
            source = source.rename(away / f"blob{name[0]}{len(name)}")
        (tmp_path / name).symlink_to(source)
    looks = load_mesh(tmp_path / "model.obj").looks
    assert looks is not None
    assert looks.materials[0].color == (1.0, 0.0, 0.0)


def test_no_mesh_is_written_over_through_a_link(tmp_path: Path):
    (tmp_path / "link.obj").symlink_to("box.obj")
    write_obj(tmp_path / "box.obj", cube())
    with pytest.raises(InputError, match=r"link\.obj: is the input mesh"):
        app(["remesh", f"{tmp_path}/box.obj", "-o", f"{tmp_path}/link.obj"], standalone_mode=False)


@pytest.mark.parametrize("kind", ["circle", "dangling"])
def test_a_link_that_leads_nowhere_is_one_sentence_as_an_input(kind: str, stage: Path, tmp_path: Path):
    for name in ("mesh.obj", "stage.usdc", "scene.toml"):
        (tmp_path / name).symlink_to(name if kind == "circle" else f"gone_{name}")
    for name in ("mesh.obj", "scene.toml"):
        with pytest.raises(InputError, match=f"{name}: no such .*; it is a broken link to .*{name}$"):
            load_scene(tmp_path / name)
    write_obj(tmp_path / "box.obj", cube())
    swapped = load_scene(tmp_path / "box.obj", {"balloon.mesh": str(tmp_path / "mesh.obj")})
    with pytest.raises(InputError, match=r"mesh\.obj: no such file; it is a broken link to "):
        animate(swapped, tmp_path / "out.usdc", device="cpu")
    with pytest.raises(InputError, match=r"stage\.usdc: no such .*; it is a broken link to "):
        WRITERS["render"](tmp_path / "stage.usdc", tmp_path / "out.png")
    (tmp_path / "link.usdc").symlink_to(stage)  # one that leads to a stage is drawn and converted
    for writer, output in (("render", "out.png"), ("export", "out.glb")):
        WRITERS[writer](tmp_path / "link.usdc", tmp_path / output)
        assert (tmp_path / output).is_file()
