"""Files whose place an output may take: the program's own, none of its inputs, and nobody else's at the same time."""

import json
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from commands import status_of
from meshes import cube
from painted import atlas, write_obj_cube, write_painted
from PIL import Image

from balloon_warp import Balloon, InputError, Obstacle, Scene, animate, design, load_scene, run_batch
from balloon_warp.lab.fit.fit import Journal
from balloon_warp.mesh.obj import write_obj
from balloon_warp.scene.write import write_scene
from balloon_warp.studio.animate import Wanted
from balloon_warp.studio.render.render import Film
from balloon_warp.system.files import is_ours, replacing_any, sole_writer

BOX = Scene(balloon=[Balloon(mesh=cube(), name="box")], frames=1)
RUN, COMPARE = "run box.obj --frames 1 --device cpu", "compare box.obj --vary balloon.mass=1,2 --frames 1 --device cpu"
BATCH = "batch box.obj --worlds 2 --frames 1 --device cpu"
DATA = "--trajectories data --format npz"


@pytest.fixture(scope="module")
def stage(tmp_path_factory: pytest.TempPathFactory) -> Path:
    animate(BOX, path := tmp_path_factory.mktemp("stage") / "film.usdc", device="cpu")
    return path


@pytest.fixture
def folder(tmp_path: Path, stage: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return the working folder: a mesh without a texture, one with it, and a stage. Pictures are small."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(
        "balloon_warp.studio.render.render.Film", lambda size, samples, *others: Film((64, 36), 1, *others)
    )
    write_obj(tmp_path / "box.obj", cube())
    write_painted(tmp_path, "obj")
    (tmp_path / "film.usdc").write_bytes(stage.read_bytes())
    return tmp_path


def contents(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


@pytest.mark.parametrize(
    ("words", "mine"),
    [
        pytest.param(RUN, "box.usdc", id="run"),
        pytest.param(f"{RUN} --picture", "box.png", id="its picture"),
        pytest.param(f"{RUN} --picture -o named.usdc", "named.png", id="the picture beside a named stage"),
        pytest.param(f"{RUN} -o f.####.obj", "f.0001.obj", id="a frame, .obj"),
        pytest.param(f"{RUN} -o f.####.ply", "f.0000.ply", id="a frame, .ply"),
        pytest.param(f"{RUN} -o f.pvd", "f.0001.vtu", id="a frame, .vtu"),
        pytest.param("convert film.usdc -o f.####.obj", "f.0000.obj", id="a converted frame"),
        pytest.param("render film.usdc --device cpu", "film.png", id="render"),
        pytest.param(COMPARE, "box_compare.png", id="compare"),
        pytest.param(BATCH, "box_batch/table.csv", id="batch"),
        pytest.param(f"{BATCH} -o .", "manifest.json", id="a batch among other files"),
        pytest.param(f"{BATCH} --table csv", "box_batch/table.parquet", id="a table of the kind that goes"),
        pytest.param(f"{BATCH} {DATA}", "data/train/world_000000.npz", id="trajectories"),
        pytest.param(f"{BATCH} {DATA}", "data/manifest.json", id="the manifest of trajectories"),
        pytest.param("scenes squirrel_tether -o mine.toml", "mine.toml", id="scenes"),
        pytest.param("scenes squirrel_tether -o mine.toml", "squirrel.obj", id="a mesh beside a scene"),
        pytest.param("foil I -o i.toml", "i.toml", id="a scene of foil"),
        pytest.param("foil I -o i.obj --apart", "i_1.obj", id="a part of foil"),
        pytest.param("design box.obj -o d --steps 0 --device cpu", "d/error.png", id="design"),
        pytest.param("remesh cube.obj -o q.obj --cells 6", "q.mtl", id="materials of a mesh"),
    ],
)
def test_what_the_program_did_not_make_stays(words: str, mine: str, folder: Path, capfd) -> None:
    (folder / mine).parent.mkdir(parents=True, exist_ok=True)
    (folder / mine).write_text("MINE\n")
    before = contents(folder)
    assert status_of(*words.split()) == 2
    said = [line for line in capfd.readouterr().err.splitlines() if not line.startswith("note: ")]
    assert len(said) == 1
    assert mine in said[0]
    assert "--force" in said[0]
    assert contents(folder) == before


@pytest.mark.parametrize(
    ("words", "made"),
    [
        pytest.param(f"{RUN} --picture", ["box.usdc", "box.png"], id="run"),
        pytest.param(f"{RUN} -o f.####.ply", ["f.0001.ply"], id="a sequence"),
        pytest.param(f"{RUN} -o f.pvd", ["f.0001.vtu"], id="grids"),
        pytest.param("render film.usdc --size 64x64 --samples 1 --device cpu", ["film.png"], id="render"),
        pytest.param(f"{BATCH} {DATA}", ["box_batch/table.csv", "data/manifest.json"], id="batch"),
        pytest.param("scenes squirrel_tether -o mine.toml", ["mine.toml", "squirrel.obj"], id="scenes"),
        pytest.param("foil I -o i.toml", ["i.toml", "i_1.obj"], id="foil"),
        pytest.param("remesh cube.obj -o q.obj --cells 6", ["q.mtl"], id="remesh"),
    ],
)
def test_what_the_program_made_is_replaced_and_all_else_by_force(words: str, made: list[str], folder: Path) -> None:
    for _ in range(2):
        assert status_of(*words.split()) == 0
    for name in made:
        (folder / name).write_text("MINE\n")
    assert status_of(*words.split(), "--force") == 0
    assert all((folder / name).read_bytes() != b"MINE\n" for name in made)


def test_a_scene_is_ours_until_it_is_edited(tmp_path: Path) -> None:
    path = tmp_path / "box.toml"
    write_obj(tmp_path / "box.obj", cube())
    scene = load_scene(tmp_path / "box.obj")
    write_scene(scene, path)
    assert is_ours(path)
    write_scene(scene, path)
    path.write_text(path.read_text() + "# a thought\n")
    with pytest.raises(InputError, match=r"box\.toml: .*edited it"):
        write_scene(scene, path)
    with replacing_any():
        write_scene(scene, path)
    assert load_scene(path) == scene


def test_an_edited_scene_and_a_target_in_the_folder_of_a_design_stay(tmp_path: Path) -> None:
    write_obj(tmp_path / "balloon.obj", cube())
    (tmp_path / "report.json").write_text(json.dumps({"written_by": "Balloon Warp"}))
    with pytest.raises(InputError, match=r"balloon\.obj: is an input of the design"):
        design(tmp_path / "balloon.obj", folder=tmp_path, device="cpu")
    (tmp_path / "balloon.toml").write_text("frames = 7\n")
    with pytest.raises(InputError, match=r"balloon\.toml: .*edited it"):
        design(cube(), folder=tmp_path, device="cpu")
    assert (tmp_path / "balloon.toml").read_text() == "frames = 7\n"


def test_a_file_in_place_of_a_journal_stays(tmp_path: Path) -> None:
    path = tmp_path / "points.progress"
    path.write_text("MINE")
    with pytest.raises(InputError, match=r"points\.progress: another program wrote it"):
        Journal(path, {}, resume=False)
    assert path.read_text() == "MINE"
    path.unlink()
    for resume in (False, False, True):
        Journal(path, {"bounds": 1}, resume).close(done=False)


def test_a_texture_that_was_painted_over_stays(folder: Path) -> None:
    scene = load_scene(folder / "cube.obj", {"frames": 1})
    animate(scene, folder / "out.usdc", device="cpu")
    (image,) = (folder / "textures").iterdir()
    Image.new("RGB", (8, 8)).save(image)
    painted = image.read_bytes()
    with pytest.raises(InputError, match=r"textures.*: was edited"):
        animate(scene, folder / "out.usdc", device="cpu", on_frame=lambda _: pytest.fail("simulates"))
    assert image.read_bytes() == painted
    with replacing_any():
        animate(scene, folder / "out.usdc", device="cpu")
    assert image.read_bytes() != painted


INPUTS = {"box.usdc": "mesh", "box.png": "print", "tiles.usdc": "mesh"}


@pytest.mark.parametrize("output", INPUTS)
def test_an_output_is_no_input(output: str, folder: Path, stage: Path) -> None:
    for name in INPUTS:
        (folder / name).write_bytes(stage.read_bytes())
    balloon = Balloon(mesh=folder / "box.usdc", print=folder / "box.png")
    scene = Scene(balloon=[balloon], obstacle=[Obstacle(shape="mesh", mesh=folder / "tiles.usdc")], frames=1)
    wanted = Wanted(folder / "out.usdc", folder / output) if output == "box.png" else Wanted(folder / output)
    with pytest.raises(InputError, match=f"{output}: is the scene's {INPUTS[output]}; "):
        wanted.checked(scene)


def test_names_that_nobody_gave_are_no_inputs(folder: Path) -> None:
    """A texture and a mesh that stand where a picture and a stage usually go."""
    write_obj_cube(folder, "newmtl paint\nmap_Kd cube.png\n")
    atlas().save(folder / "cube.png")
    (folder / "film.toml").write_text('frames = 1\n[[balloon]]\nmesh = "film.usdc"\n')
    inputs = contents(folder)
    assert status_of("run", "cube.obj", "--frames", "1", "--picture", "--device", "cpu") == 0
    assert status_of("run", "film.toml", "--device", "cpu") == 0
    assert contents(folder).items() > inputs.items()
    assert is_ours(folder / "cube_balloon.png")
    assert is_ours(folder / "film_balloon.usdc")


def test_an_output_has_one_writer(tmp_path: Path) -> None:
    path, named = tmp_path / "out.usdc", tmp_path / "out.png"
    with sole_writer(path), sole_writer(path, None, named), ThreadPoolExecutor(1) as other:
        simulates = {"device": "cpu", "on_frame": lambda _: pytest.fail("simulates")}
        refusal = other.submit(animate, BOX, path, **simulates).exception()
    assert isinstance(refusal, InputError)
    assert "out.usdc: process " in str(refusal)
    assert "is writing it; wait for its end, or give another name, with -o" in str(refusal)
    assert list(tmp_path.iterdir()) == []
    with sole_writer(tmp_path), ThreadPoolExecutor(1) as other, pytest.raises(InputError, match="is writing it"):
        other.submit(run_batch, BOX, tmp_path, 2, device="cpu").result()
    with sole_writer(path):
        pass
