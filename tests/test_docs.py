"""Code on the pages of the docs: their Python runs, and their commands exist."""

import importlib.util
import re
import shlex
import tomllib
from collections.abc import Iterable, Iterator
from functools import partial
from importlib.util import find_spec
from pathlib import Path

import pytest
import typer
from meshes import quad_sphere
from typer.testing import CliRunner

from balloon_warp.cli.app import app
from balloon_warp.mesh.obj import write_obj
from balloon_warp.outputs import render as package
from balloon_warp.outputs.render import render_stage
from balloon_warp.scene import bundled_scenes

ROOT = Path(__file__).parent.parent
PAGES = [ROOT / "README.md", ROOT / "SECURITY.md", *sorted((ROOT / "docs").glob("*.md"))]
COMMANDS = typer.main.get_command(app).commands  # pyright: ignore[reportAttributeAccessIssue]
RUN_ELSEWHERE = {"README.md", "PYTHON.md", "LAWS.md", "ARCHITECTURE.md"}
"""pages with Python that test_readme.py and test_law_docs.py run, since they look at what comes of it"""


def code(page: Path, language: str) -> list[str]:
    """Return the blocks of a page in a language."""
    return re.findall(rf"```{language}\n(.*?)```", page.read_text(encoding="utf-8"), re.DOTALL)


def commands(page: Path) -> Iterator[str]:
    """Yield the commands of `balloon-warp` in a page's blocks and sentences."""
    for block in code(page, "sh"):
        for line in block.replace("\\\n", " ").splitlines():
            yield from (part.strip() for part in line.split("&&") if part.strip().startswith("balloon-warp "))
    prose = re.sub(r"```.*?```", "", page.read_text(encoding="utf-8"), flags=re.DOTALL)
    yield from re.findall(r"`(balloon-warp [^`]+)`", prose)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_commands_are_ones_that_there_are(page: Path):
    """Commands exist, with their options and values of their kind; COMMAND stands for any."""
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
    "page",
    [page for page in PAGES if code(page, "python") and page.name not in RUN_ELSEWHERE],
    ids=lambda page: page.stem,
)
def test_the_python_of_a_page_runs(
    page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    """A page's Python blocks run one after the other from a file, and print what the page says."""
    monkeypatch.setenv("MPLBACKEND", "Agg")
    file = tmp_path / f"page_{page.stem.lower()}.py"
    file.write_text("\n\n".join(code(page, "python")), encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    spec = importlib.util.spec_from_file_location(file.stem, file)
    assert spec
    assert spec.loader
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    assert module.moved.points[0].shape[-1] == 3
    printed = capsys.readouterr().out
    for said in re.findall(r"It prints `([^`]+)`", page.read_text(encoding="utf-8")):
        assert said in printed


SHORT = {"run": "--frames 51", "render": "--size 32x18 --samples 1"}
"""what makes a command quick that takes long as it stands"""
TRIED = ("README.md", "START.md", "OUTPUTS.md")
"""pages whose commands are run; those of the others go on for long, or on machines that are not here"""


@pytest.mark.full
def test_commands_of_the_first_pages_work(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Commands of the first pages succeed one after the other in one folder, as a reader runs them; each once, with few
    frames and small pictures. `view` and `batch` have other tests."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(package, "render_stage", partial(render_stage, size=(32, 18), samples=1))
    write_obj(Path("MESH.obj"), quad_sphere(4))
    (scene,) = code(ROOT / "docs" / "START.md", "toml")
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
    """Every page is in the site's contents, every command in the table of commands, every scene in the gallery, and
    every extra in the installation instructions."""
    index = (ROOT / "docs" / "index.md").read_text(encoding="utf-8").splitlines()
    pages = [page.stem for page in PAGES if page.parent.name == "docs" and page.stem != "index"]
    assert [page for page in pages if index.count(page) != 1] == []

    def unsaid(page: str, names: Iterable[str], said: str) -> list[str]:
        text = (ROOT / "docs" / page).read_text(encoding="utf-8")
        return [name for name in names if said.format(name) not in text]

    assert unsaid("COMMANDS.md", COMMANDS, "| `balloon-warp {}") == []
    assert unsaid("GALLERY.md", bundled_scenes(), "`{}`") == []
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["optional-dependencies"]
    assert unsaid("INSTALL.md", extras, "| `{}` |") == []
