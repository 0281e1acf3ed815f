"""Code in the README, which works as printed."""

import re
import tomllib
from pathlib import Path

import pytest
from meshes import quad_sphere

from balloon_warp.benchmarks.performance import RESULTS, rates
from balloon_warp.mesh.obj import write_obj
from balloon_warp.scene import Scene

ROOT = Path(__file__).parent.parent
README = (ROOT / "README.md").read_text(encoding="utf-8")


def block(language: str, page: str = README) -> str:
    return re.findall(rf"```{language}\n(.*?)```", page, re.DOTALL)[0]


def test_it_is_short_and_begins_with_the_two_commands():
    """The README is short, and its first two lines that begin with `pip install` are those of CI."""
    assert README.count("\n") <= 110
    commands = re.findall(r"^pip install .*", README, re.MULTILINE)
    assert commands == [
        "pip install . && balloon-warp run squirrel_tether --picture",
        "pip install '.[test]' && pytest",
    ]


def test_python_example_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.chdir(tmp_path)
    exec(block("python"), names := {})
    assert sorted(path.name for path in tmp_path.iterdir()) == ["squirrel.png", "squirrel.usdc"]
    assert names["moved"].points[0].shape[:2] == (2, 61)


def test_the_python_page_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Blocks of the page run one after the other."""
    monkeypatch.chdir(tmp_path)
    write_obj(Path("ball.obj"), quad_sphere(2))
    page = (ROOT / "docs" / "PYTHON.md").read_text(encoding="utf-8")
    exec("".join(re.findall(r"```python\n(.*?)```", page, re.DOTALL)), names := {})
    assert sorted(path.name for path in tmp_path.iterdir()) == ["ball.obj", "compare.png", "out"]
    assert names["heavy"].balloon[0].mass == 2.0
    assert names["many"].points[0].shape == (8, 3, 26, 3)
    assert names["pinned"].fixed


def test_scene_example_is_valid():
    start = (ROOT / "docs" / "START.md").read_text(encoding="utf-8")
    scene = Scene.model_validate(tomllib.loads(block("toml", start)))
    assert (len(scene.balloon), len(scene.sphere), len(scene.string)) == (1, 1, 1)


@pytest.mark.parametrize(
    "page", ["README.md", "SECURITY.md", *(f"docs/{path.name}" for path in (ROOT / "docs").glob("*.md"))]
)
def test_links_lead_somewhere(page: str):
    path = ROOT / page
    links = re.findall(r"\]\(([^)]+)\)", path.read_text(encoding="utf-8"))
    files = [path.parent / link.partition("#")[0] for link in links if not link.startswith("http") and link[0] != "#"]
    assert files
    assert [file for file in files if not file.exists()] == []


def test_its_speeds_are_those_that_were_measured():
    """Speeds in the README are the measured ones, to their two digits."""
    found = rates((ROOT / RESULTS).read_text(encoding="utf-8"))
    for name, (ours, peer) in found.items():
        cells = next(line for line in README.splitlines() if line.startswith(f"| {name} |")).split("|")[2:5]
        assert f"{float(cells[0].split()[0]):.2g} million" == f"{ours:.2g} million"
        if peer:
            assert float(cells[1].split()[0]) == pytest.approx(peer, rel=0.03)
            assert float(cells[2].split()[0]) == pytest.approx(ours / peer, abs=1.0)
