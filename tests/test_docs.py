"""Pages of the docs and docstrings: their code runs, their links lead somewhere, and they are complete."""

import ast
import contextlib
import importlib.util
import os
import re
import shlex
import shutil
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
import typer
from meshes import quad_sphere
from typer.testing import CliRunner

from balloon_warp import Scene, Simulator, bundled_scenes, render_stage
from balloon_warp.benchmarks.performance import RESULTS, rates
from balloon_warp.cli.app import app
from balloon_warp.kernels import substep
from balloon_warp.kernels.laws.law import LAW_INPUTS
from balloon_warp.mesh.obj import write_obj
from balloon_warp.studio import render as package

ROOT = Path(__file__).parent.parent
PAGES = [ROOT / "README.md", ROOT / "SECURITY.md", *sorted((ROOT / "docs").glob("*.md"))]
COMMANDS = typer.main.get_command(app).commands  # pyright: ignore[reportAttributeAccessIssue]
ELSEWHERE = {"README.md", "PYTHON.md", "LAWS.md", "ARCHITECTURE.md", "EXTENDING.md"}
"""pages with Python that tests below run, since they look at its results"""


def text_of(page: Path | str) -> str:
    return (ROOT / page).read_text(encoding="utf-8")


def code(page: Path | str, language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", text_of(page), re.DOTALL)


def run_python(page: Path | str, folder: Path) -> ModuleType:
    """Run a page's Python blocks one after the other, from a file: Warp reads the source of laws."""
    file = folder / f"page_{Path(page).stem.lower()}.py"
    file.write_text("\n\n".join(code(page, "python")), encoding="utf-8")
    spec = importlib.util.spec_from_file_location(file.stem, file)
    assert spec
    assert spec.loader
    module = importlib.util.module_from_spec(spec)
    with contextlib.chdir(folder):
        spec.loader.exec_module(module)
    return module


def written_in(folder: Path) -> set[str]:
    """Return the names in a folder, without the page's own file."""
    return {path.name for path in folder.iterdir() if not path.name.startswith(("page_", "__"))}


def commands(page: Path) -> Iterator[str]:
    """Yield the commands of `balloon-warp` in a page's blocks and sentences."""
    for block in code(page, "sh"):
        for line in block.replace("\\\n", " ").splitlines():
            yield from (part.strip() for part in line.split("&&") if part.strip().startswith("balloon-warp "))
    yield from re.findall(r"`(balloon-warp [^`]+)`", re.sub(r"```.*?```", "", text_of(page), flags=re.DOTALL))


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_commands_are_ones_that_there_are(page: Path):
    for line in commands(page):
        name, *words = shlex.split(line.replace("\\|", "|"), comments=True)[1:]
        if name == "COMMAND":
            continue
        if name.startswith("-"):
            assert name in ("--version", "--help"), line
            continue
        assert name in COMMANDS, line
        try:
            COMMANDS[name].make_context(name, words)
        except Exception as error:
            if type(error).__name__ not in ("Exit", "MissingParameter"):  # `balloon-warp view` alone is a name
                pytest.fail(f"{page.name}: {line}: {error}")


@pytest.mark.full
@pytest.mark.parametrize(
    "page", [page for page in PAGES if code(page, "python") and page.name not in ELSEWHERE], ids=lambda page: page.stem
)
def test_the_python_of_a_page_runs(page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys):
    monkeypatch.setenv("MPLBACKEND", "Agg")
    monkeypatch.setattr(substep, "STEP", substep.STEP)  # a page may list a phase of its own
    assert run_python(page, tmp_path).moved.points[0].shape[-1] == 3
    printed = capsys.readouterr().out
    for said in re.findall(r"It prints `([^`]+)`", text_of(page)):
        assert said in printed


SHORT = {"run": "--frames 51", "render": "--size 32x18 --samples 1"}
"""options that make a command quick that takes long as it stands"""
TRIED = ("README.md", "START.md", "OUTPUTS.md")
"""pages whose commands are run; those of the others go on for long, or on machines that are not here"""


@pytest.mark.full
def test_commands_of_the_first_pages_work(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Commands run in turn in one folder, as for a reader, with few frames; `view` and `batch` have other tests."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(package, "render_stage", partial(render_stage, size=(32, 18), samples=1))
    write_obj(Path("MESH.obj"), quad_sphere(4))
    (scene,) = code("docs/START.md", "toml")
    Path("first.toml").write_text(scene, encoding="utf-8")
    blocks = [block for page in PAGES if page.name in TRIED for block in code(page, "sh")]
    lines = [shlex.split(line, comments=True) for block in blocks for line in block.splitlines()]
    done: list[list[str]] = []
    for line in lines:
        if line in done or line[:1] != ["balloon-warp"] or line[1] not in ("run", "render", "inspect", "scenes"):
            continue
        done.append(line)
        _, name, *words = line
        if not find_spec("imageio_ffmpeg"):
            words = [word.replace(".mp4", ".gif") for word in words]
        if not find_spec("h5py") and "points.h5" in words:
            continue
        shorter = [] if "--seconds" in words else SHORT.get(name, "").split()
        result = CliRunner().invoke(app, [name, *words, *shorter])
        assert result.exit_code == 0, f"{shlex.join(line)}: {result.output}"
    assert len(done) > 10


def test_nothing_is_left_out():
    index = text_of("docs/index.md").splitlines()
    pages = [page.stem for page in PAGES if page.parent.name == "docs" and page.stem != "index"]
    assert [page for page in pages if index.count(page) != 1] == []
    extras = tomllib.loads(text_of("pyproject.toml"))["project"]["optional-dependencies"]
    tables = [("COMMANDS", COMMANDS, "| `balloon-warp {}"), ("GALLERY", bundled_scenes(), "`{}`")]
    for page, names, said in (*tables, ("INSTALL", extras, "| `{}` |")):
        assert [name for name in names if said.format(name) not in text_of(f"docs/{page}.md")] == []


README = text_of("README.md")


def test_it_is_short_and_begins_with_the_two_commands():
    assert README.count("\n") <= 110
    commands = ["pip install . && balloon-warp run squirrel_tether --picture", "pip install '.[test]' && pytest"]
    assert re.findall(r"^pip install .*", README, re.MULTILINE) == commands


def test_python_example_runs(tmp_path: Path):
    assert run_python("README.md", tmp_path).moved.points[0].shape[:2] == (2, 61)
    assert written_in(tmp_path) == {"squirrel.png", "squirrel.usdc"}
    (scene,) = code("docs/START.md", "toml")
    scene = Scene.model_validate(tomllib.loads(scene))
    assert (len(scene.balloon), len(scene.sphere), len(scene.string)) == (1, 1, 1)


@pytest.mark.full
def test_the_python_page_runs(tmp_path: Path):
    write_obj(tmp_path / "ball.obj", quad_sphere(2))
    page = run_python("docs/PYTHON.md", tmp_path)
    assert written_in(tmp_path) == {"ball.obj", "compare.png", "out"}
    assert page.heavy.balloon[0].mass == 2.0
    assert page.many.points[0].shape == (8, 3, 26, 3)
    assert page.pinned.fixed


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_links_lead_somewhere(page: Path):
    links = re.findall(r"\]\(([^)]+)\)", text_of(page))
    files = [page.parent / link.partition("#")[0] for link in links if not link.startswith("http") and link[0] != "#"]
    assert files
    assert [file for file in files if not file.exists()] == []


def test_its_speeds_are_those_that_were_measured():
    lines = text_of("docs/PERFORMANCE.md").splitlines()
    for name, (ours, peer) in rates(text_of(RESULTS)).items():
        cells = next(line for line in lines if line.startswith(f"| {name} |")).split("|")[2:5]
        assert f"{float(cells[0].split()[0]):.2g} million" == f"{ours:.2g} million"
        if peer:
            assert float(cells[1].split()[0]) == pytest.approx(peer, rel=0.03)
            assert float(cells[2].split()[0]) == pytest.approx(ours / peer, abs=1.0)
    said = re.findall(r"^\| [a-z0-9].* \| ([^|]*) \| [^|:]*: ([^|]*) \| ([0-9]+) times", README, re.MULTILINE)
    assert len(said) == 3
    for row in said:
        assert any(all(number.split()[0] in line for number in row) for line in lines), row


ROWS = re.findall(r"^\| ([a-z][^|]*?) \| ([^|]+) \| ([^|]*\]\([^|]*) \|$", text_of("docs/GLOSSARY.md"), re.MULTILINE)


def stem(word: str) -> str:
    return re.sub(r"(es|e|s|ed|y)$", "", word)


@pytest.mark.parametrize(("words", "_meaning", "home"), ROWS, ids=[row[0] for row in ROWS])
def test_a_word_stands_where_it_is_at_home(words: str, _meaning: str, home: str):
    files = [(ROOT / "docs" / link).resolve() for link in re.findall(r"\]\(([^)]+)\)", home)]
    said = " ".join(f"{file.stem} {text_of(file)}" for file in files).lower()
    said = re.sub(r"[\s_-]+", " ", said)
    for word in words.split(", "):
        assert all(stem(part) in said for part in re.split("[ -]", word.lower())), word


LAWS = text_of("docs/LAWS.md")
RUN = """
import warp as wp
from balloon_warp.scene import load_scene
from balloon_warp.simulator import Simulator
wp.config.optimization_level = 0
for charge in (0.0, 0.5):
    simulator = Simulator(load_scene("net_forces", {"balloon.law.charge.charge": charge}), "cpu", schedule="scatter")
    simulator.step()
    print([law.name for law in simulator.model.laws][-1], float(simulator.state.points.numpy().sum()))
"""
"""with a law of the package's, without and with it, by kernels that stay as they are written: for a frame"""


@pytest.fixture(scope="module")
def laws_code(tmp_path_factory: pytest.TempPathFactory) -> ModuleType:
    return run_python("docs/LAWS.md", tmp_path_factory.mktemp("laws"))


@pytest.mark.full
def test_each_law_of_the_page_acts(laws_code: ModuleType):
    assert laws_code.frame.number == 4
    assert [law.name for law in laws_code.laws] == ["magnet", "stiffening", "gust"]
    assert (Path(laws_code.__file__ or "").parent / "out" / "table.csv").exists()
    vary = {"balloon.law.magnet.strength": [20, 0, 20, 20], "balloon.law.stiffening.hardness": [3, 3, 0, 3]}
    vary["law.gust.gust_velocity.0"] = [4, 4, 4, 0]
    scene = laws_code.scene.model_copy(update={"frames": 20})
    batch = Simulator(scene, "cpu", world_count=4, vary=vary, laws=laws_code.laws)
    for _ in range(20):
        batch.step()
    points = batch.state.points.numpy()
    for without in points[1:]:
        assert np.abs(without - points[0]).max() > 1e-3


@pytest.mark.full
def test_the_tables_and_the_mistake_are_those_of_the_code(laws_code: ModuleType):
    tables = []
    for kind in ("particle", "spring", "face"):
        cells = [(each.name, each.type, each.meaning.replace("|", "\\|")) for each in LAW_INPUTS[kind]]
        rows = [f"| `{name}` | {type} | {meaning} |" for name, type, meaning in cells]
        tables.append("\n".join([f"| of a {kind} | type | |", "|---|---|---|", *rows]))
    assert re.findall(r"<!-- given -->\n\n(.*?)\n\n<!-- end -->", LAWS, re.DOTALL) == ["\n\n".join(tables)]
    assert f"> {laws_code.mistake}\n" in LAWS


@pytest.mark.full
def test_a_law_goes_in_with_one_file_and_its_name(tmp_path: Path):
    for folder in ("balloon_warp", "kernels", "scenes", "tests"):
        shutil.copytree(ROOT / folder, tmp_path / folder, ignore=shutil.ignore_patterns("__pycache__"))
    (law,) = (each for each in code("docs/EXTENDING.md", "python") if "CHARGE = Law(" in each)
    (tmp_path / "kernels" / "laws" / "charge.py").write_text(law, encoding="utf-8")
    listed = tmp_path / "kernels" / "laws" / "__init__.py"
    source = listed.read_text(encoding="utf-8")
    (laws,) = re.findall(r"^LAWS: .*?\((.*?)\)$", source, re.MULTILINE | re.DOTALL)
    imported = "from balloon_warp.kernels.laws.charge import CHARGE\n"
    first = source.index("from balloon_warp")
    listed.write_text(source[:first] + imported + source[first:].replace(laws, laws + ", CHARGE"), encoding="utf-8")

    def python(*arguments: str) -> str:
        environment = os.environ | {"PYTHONPATH": str(tmp_path)}
        command = [sys.executable, *arguments]
        done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stdout + done.stderr
        return done.stdout

    without, with_it = (line.split() for line in python("-c", RUN).splitlines() if line.startswith("charge"))
    assert without != with_it
    files = [f"tests/{name}.py" for name in ("test_laws", "test_own_laws", "full/test_law_schedules")]
    options = ["-m", "pytest", "--full", "-n", "0", "-v", "-p", "no:cacheprovider"]
    tested = python(*options, *files, "-k", "charge and not block")
    assert tested.count("[charge] PASSED") >= 5
    assert re.search(r"in_every_schedule\[.*charge.*\] PASSED", tested)


FOLDERS = ("balloon_warp", "kernels", "scenes", "benchmarks", "docs", "tests")
OPENING = re.compile(
    r"^(Of|What|Whatever|Where|Wherever|Who|Whose|Which|Whichever|Those|These|They|Their|Them|It|Its|This|That"
    r"|The same|Same|Such|How|However|By|If|When|Whether|From|For|In|On|At|With|Within|Without|As|To|And|But|Or|Nor"
    r"|So|Not|All|One|Once|Like|Over|Then|Here|There)\b"
)
"""beginnings of half a sentence: a preposition, a conjunction, or a pronoun that leads nowhere"""
POINTING = re.compile(
    r"^\w+ (down |in |out )?(of |all of |all that |what |where |whether |how |if |that )?"
    r"(it|its|they|them|those|these|this|ones|such)\b(?! itself)"
)
"""a verb whose object is a pronoun: "Write it down." """


def python_of(folder: str) -> Iterator[tuple[str, ast.AST]]:
    for path in sorted((ROOT / folder).rglob("*.py")):
        yield from ((str(path.relative_to(ROOT)), node) for node in ast.walk(ast.parse(text_of(path))))


def docstrings(folder: str) -> Iterator[tuple[str, str]]:
    for path, node in python_of(folder):
        if isinstance(node, (ast.Module, ast.ClassDef, ast.FunctionDef)) and (text := ast.get_docstring(node)):
            yield f"{path}:{node.body[0].lineno}", text


@pytest.mark.full
@pytest.mark.parametrize("folder", FOLDERS)
def test_docstrings_begin_with_a_noun_or_a_verb(folder: str):
    found = list(docstrings(folder))
    assert len(found) > 10
    assert [each for each in found if OPENING.match(each[1]) or POINTING.match(each[1])] == []
