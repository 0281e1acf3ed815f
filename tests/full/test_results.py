"""Tables of benchmarks/RESULTS.md, printed by commands, each with its day and machine."""

from datetime import date
from pathlib import Path
from types import SimpleNamespace

import pytest

from balloon_warp.benchmarks import results
from balloon_warp.benchmarks.results import FOLDER, PAGE, again, as_markdown, as_toml, files, main, read
from balloon_warp.errors import InputError

ROOT = Path(__file__).parents[2]
RECORDS = ROOT / "docs" / "design"


@pytest.fixture(autouse=True)
def in_the_project(monkeypatch):
    monkeypatch.chdir(ROOT)


def test_the_page_is_what_the_command_writes_and_every_record_is_linked():
    assert PAGE.read_text(encoding="utf-8") == as_markdown(map(read, files().values()))
    listed = (RECORDS / "README.md").read_text(encoding="utf-8")
    for page in {*RECORDS.glob("*.md")} - {RECORDS / "README.md"}:
        assert f"]({page.name})" in listed, page.name
        assert page.read_text(encoding="utf-8").startswith(("# Why ", "# How ", "# What ")), page.name


@pytest.mark.parametrize("name", sorted(path.stem for path in (ROOT / FOLDER).glob("*.toml")))
def test_a_measurement_has_its_day_machine_and_command(name: str):
    path = FOLDER / f"{name}.toml"
    measurement = read(path)
    assert date(2026, 1, 1) < measurement.measured
    assert any(kind in measurement.machine for kind in ("H100", "H200", "CPU"))
    assert "balloon" in measurement.command
    assert measurement.table.splitlines()[1].startswith("|-")
    assert as_toml(measurement) == path.read_text(encoding="utf-8")


def test_a_measurement_is_made_again(monkeypatch, tmp_path):
    monkeypatch.setattr(results, "FOLDER", tmp_path)
    monkeypatch.setattr(results, "PAGE", tmp_path / "RESULTS.md")
    (tmp_path / "01_health.toml").write_text(as_toml(read(files_of(ROOT / FOLDER)["health"])), encoding="utf-8")
    asked: list[list[str]] = []

    def run(words: list[str], **_: object) -> SimpleNamespace:
        asked.append(words[1:])
        return SimpleNamespace(returncode=0, stdout="a line\n| case |\n|---|\n| new |\n", stderr="")

    monkeypatch.setattr(results, "subprocess", SimpleNamespace(run=run))
    main(["health"])
    assert asked == [["-m", "balloon_warp.benchmarks.health", "cpu"]]
    measured = read(tmp_path / "01_health.toml")
    assert (measured.table, measured.measured) == ("| case |\n|---|\n| new |", date.today())
    assert "| new |" in (tmp_path / "RESULTS.md").read_text(encoding="utf-8")


def files_of(folder: Path) -> dict[str, Path]:
    return {path.stem.partition("_")[2]: path for path in folder.glob("*.toml")}


def test_a_command_without_a_table_and_an_unknown_name_are_refused(monkeypatch):
    before = PAGE.read_bytes()
    with pytest.raises(InputError, match=r"^nothing: there is no such measurement; expected one of gpu, "):
        main(["nothing"])
    done = SimpleNamespace(returncode=0, stdout="nothing to see", stderr="")
    monkeypatch.setattr(results, "subprocess", SimpleNamespace(run=lambda *_, **__: done))
    with pytest.raises(InputError, match=r"benchmarks\.health cpu: expected a table \(status 0\)"):
        again(read(files()["health"]))
    assert PAGE.read_bytes() == before
