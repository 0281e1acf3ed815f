"""Programs of docs/examples run, with fewer worlds and frames than they have; notebooks of docs/notebooks are whole,
without outputs, and run from beginning to end."""

import importlib.util
import json
import os
import re
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from costs import nightly_but

EXAMPLES = Path(__file__).parents[3] / "docs" / "examples"
PROGRAMS: dict[str, tuple[dict[str, int], list[str], str | None]] = {
    "01_sweep": ({"WORLDS": 3, "FRAMES": 3}, ["sweep.png"], "matplotlib"),
    "02_pressure_curve": ({"FRAMES": 6}, ["pressure_curve.png"], "matplotlib"),
    "03_custom_law": ({"FRAMES": 6}, ["custom_law.png"], "matplotlib"),
    "04_mesh_from_trimesh": ({"FRAMES": 2, "SECTIONS": 12}, ["ring.png", "ring.usdc"], None),
    "05_state_without_copy": ({}, [], None),
    "06_batch_on_a_cluster": ({"WORLDS": 2, "FRAMES": 2}, ["lifts"], "distributed"),
    "07_results_with_pandas": ({"FRAMES": 3}, ["pandas.png", "spheres"], "pandas"),
    "08_gradient": ({}, [], None),
    "09_throw": ({}, [], None),
    "10_pump": ({}, [], None),
    "11_mesh_graph_net": ({"WORLDS": 12, "FRAMES": 4, "STEPS": 2}, ["mesh_graph_net.png", "thrown"], "torch"),
    "12_ppo": ({}, ["ppo_Inflate.csv", "ppo_Inflate.png"], "torch"),
    "13_room": ({"FRAMES": 2, "SAMPLES": 1}, ["room.png", "room.usdc"], None),
}
"""the numbers that replace each one's, the files that it makes, and the package that it needs"""
ARGUMENTS = {"12_ppo": "Inflate --envs 8 --steps 4 --updates 3 --device cpu"}
"""arguments of a program"""


def small(name: str, folder: Path) -> Path:
    """Return a copy of the program with small numbers."""
    code = (EXAMPLES / f"{name}.py").read_text(encoding="utf-8")
    for constant, number in PROGRAMS[name][0].items():
        code, count = re.subn(rf"^{constant} = \d+$", f"{constant} = {number}", code, flags=re.MULTILINE)
        assert count == 1, constant
    copy = folder / f"example_{name}.py"
    copy.write_text(code, encoding="utf-8")
    return copy


def test_all_are_here():
    assert sorted(path.stem for path in EXAMPLES.glob("*.py")) == sorted(PROGRAMS)


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return a folder for the files that programs write, with plots off the screen."""
    monkeypatch.setenv("MPLBACKEND", "Agg")
    (tmp_path / "out").mkdir()
    monkeypatch.chdir(tmp_path / "out")
    return tmp_path


def run(name: str, here: Path) -> ModuleType:
    """Import and run the program in this process, from a file, as Warp reads the source of laws."""
    spec = importlib.util.spec_from_file_location(f"example_{name}", small(name, here))
    assert spec
    assert spec.loader
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


HERE = [name for name in PROGRAMS if name != "06_batch_on_a_cluster"]


@pytest.mark.parametrize("name", nightly_but([name for name in HERE if name != "10_pump"], HERE))
def test_it_runs(name: str, here: Path, monkeypatch: pytest.MonkeyPatch):
    _, made, needed = PROGRAMS[name]
    if needed:
        pytest.importorskip(needed)
    monkeypatch.setattr(sys, "argv", [name, *ARGUMENTS.get(name, "").split()])
    module = run(name, here)
    assert sorted(path.name for path in Path().iterdir()) == made
    if name == "01_sweep":  # more pressure holds more
        assert (np.diff(module.volumes) > 0.0).all()
    if name == "02_pressure_curve":
        np.testing.assert_allclose(module.pressure, module.formula, rtol=0.05, atol=5.0)
    if name == "03_custom_law":  # it begins to go around, the way that the air turns
        assert module.path[-1, 2] < module.path[0, 2] - 0.01
    if name == "05_state_without_copy":  # 2 m/s for a frame, of which springs and damping take some
        assert 0.5 * 2.0 / 60.0 < module.risen < 2.0 / 60.0 + 0.01
    if name == "08_gradient":
        np.testing.assert_allclose(module.values, module.TRUE, rtol=1e-3)
    if name == "09_throw":  # through the ground, and into the target to a tenth of a millimeter
        assert module.moved.points[0][..., 1].min() < 1e-3
        np.testing.assert_allclose(module.path[-1], module.TARGET, atol=1e-4)
    if name == "10_pump":  # which falls by 0.9 m without
        assert module.left[-1] < 0.2
        np.testing.assert_allclose(module.held, module.HEIGHT, atol=0.05)
    if name == "12_ppo":
        assert [(row[1], np.isfinite(row[0])) for row in module.curve] == [(32, True), (64, True), (96, True)]
        assert set(module.returns) == {"random", "scripted", "learned"}
        assert module.returns["scripted"] > 50.0 > module.returns["random"]
    if name == "07_results_with_pandas":
        assert (module.by_mass["health"] == 1).all()


def test_the_cluster_s_runs(here: Path):
    """The cluster's example runs as a program, as its workers import it."""
    command = [sys.executable, str(small("06_batch_on_a_cluster", here))]
    done = subprocess.run(command, capture_output=True, text=True, env=dict(os.environ), timeout=300, check=False)
    assert done.returncode == 0, done.stderr
    assert "'balloon.helium': (6,)" in done.stdout
    assert sorted(path.name for path in Path().iterdir()) == ["lifts"]


FOLDER = Path(__file__).parents[3] / "docs" / "notebooks"
NOTEBOOKS = sorted(FOLDER.glob("*.ipynb"))


def test_there_is_one_for_each_reader():
    assert {path.stem for path in NOTEBOOKS} == {"animators", "learners", "researchers"}


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_is_kept_without_outputs(path: Path):
    cells = json.loads(path.read_text(encoding="utf-8"))["cells"]
    assert [cell for cell in cells if cell.get("outputs") or cell.get("execution_count")] == []


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_links_of_a_notebook_lead_to_pages(path: Path):
    text = path.read_text(encoding="utf-8")
    links = [part.partition(")")[0] for part in text.split("](")[1:]]
    assert links
    assert [link for link in links if not (FOLDER / link).exists()] == []


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_runs(path: Path, tmp_path: Path):
    nbformat = pytest.importorskip("nbformat")
    nbclient = pytest.importorskip("nbclient")
    pytest.importorskip("ipykernel")
    if path.stem == "learners":
        pytest.importorskip("gymnasium")
    notebook = nbformat.read(path, as_version=4)
    nbclient.NotebookClient(notebook, timeout=600, resources={"metadata": {"path": str(tmp_path)}}).execute()
