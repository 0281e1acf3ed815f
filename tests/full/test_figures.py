"""Table of the paper's figures: every figure is there, every command runs, every test exists."""

import ast
import re
import shlex
import sys
from pathlib import Path

import pytest

from balloon_warp.cli import main
from balloon_warp.scene import bundled_scenes

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "FIGURES.md").read_text(encoding="utf-8")
ROWS = [line for line in PAGE.splitlines() if re.match(r"\| .*`balloon-warp", line)]
COMMANDS = [shlex.split(command) for row in ROWS for command in re.findall(r"`balloon-warp (.*?)`", row)]
FIGURES = {*range(1, 27)}


def figures(row: str) -> list[int]:
    """Return the numbers in a row's first cell; none for a claim."""
    first = row.split("|")[1].strip()
    return [int(number) for number in first.split(",")] if re.fullmatch(r"[\d, ]+", first) else []


def test_every_figure_has_a_row():
    assert {number for row in ROWS for number in figures(row)} == FIGURES


@pytest.mark.parametrize("row", ROWS, ids=[row.split("|")[1].strip() for row in ROWS])
def test_the_test_of_each_row_exists(row: str):
    for name, link in re.findall(r"\[(test_\w+)\]\(([^)]+)\)", row):
        tree = ast.parse((ROOT / "docs" / link).read_text(encoding="utf-8"))
        assert name in [node.name for node in tree.body if isinstance(node, ast.FunctionDef)]
    assert "[test_" in row


def short(arguments: list[str]) -> list[str]:
    """Return the command for two frames, with small pictures or none: they take longer than all the rest."""
    if arguments[0] == "inspect":
        return arguments
    kept = [re.sub("(?<=^picture_frame=).*", "0,1,2", argument) for argument in arguments if argument != "--picture"]
    small = ["--size", "64x64"] if arguments[0] == "compare" else []
    return [*kept, *small, "--set", "frames=2", "--device", "cpu"]


@pytest.mark.parametrize("arguments", COMMANDS, ids=[" ".join(arguments) for arguments in COMMANDS])
def test_each_command_runs(arguments: list[str], tmp_path, monkeypatch, capsys):
    assert arguments[1] in bundled_scenes()
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", ["balloon-warp", *short(arguments)])
    with pytest.raises(SystemExit) as ended:
        main()
    said = capsys.readouterr()
    assert (ended.value.code or 0) == 0
    assert all(", schedule " in line for line in said.err.splitlines()), said.err  # the first of each run's log
    assert "refused" not in said.out
    assert "blew up" not in said.out
    if arguments[0] != "inspect":
        assert [path.name in said.out for path in tmp_path.iterdir()] == [True]
