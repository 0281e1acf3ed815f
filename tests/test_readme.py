"""What the README shows works as it stands there."""

import re
import tomllib
from pathlib import Path

import pytest

from balloon_warp.scene import Scene

ROOT = Path(__file__).parent.parent
README = (ROOT / "README.md").read_text(encoding="utf-8")


def block(language: str) -> str:
    return re.findall(rf"```{language}\n(.*?)```", README, re.DOTALL)[0]


def test_python_example_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.chdir(tmp_path)
    exec(block("python"), {})
    assert sorted(path.name for path in tmp_path.iterdir()) == ["squirrel.png", "squirrel.usdc"]


def test_scene_example_is_valid():
    scene = Scene.model_validate(tomllib.loads(block("toml")))
    assert (len(scene.balloon), len(scene.sphere), len(scene.string)) == (1, 1, 1)


def test_links_lead_somewhere():
    links = [link for link in re.findall(r"\]\(([^)]+)\)", README) if not link.startswith("http")]
    assert len(links) > 20
    assert [link for link in links if not (ROOT / link).exists()] == []
