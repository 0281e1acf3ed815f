"""Code of docs/LAWS.md runs as printed, and its tables are those of the code. The law of docs/ARCHITECTURE.md is added
as it says."""

import importlib.util
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from balloon_warp.kernels.laws.law import LAW_INPUTS
from balloon_warp.simulator import Simulator

ROOT = Path(__file__).parent.parent
PAGE = (ROOT / "docs" / "LAWS.md").read_text(encoding="utf-8")
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
def code(tmp_path_factory: pytest.TempPathFactory) -> ModuleType:
    """Return the page's code as one module, in a file: Warp reads the source of laws."""
    folder = tmp_path_factory.mktemp("laws")
    file = folder / "laws_of_the_docs.py"
    file.write_text("\n\n".join(re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL)), encoding="utf-8")
    spec = importlib.util.spec_from_file_location(file.stem, file)
    assert spec
    assert spec.loader
    module = importlib.util.module_from_spec(spec)
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        spec.loader.exec_module(module)
    return module


@pytest.mark.full
def test_the_code_runs(code: ModuleType):
    assert code.frame.number == 4
    assert [law.name for law in code.laws] == ["magnet", "stiffening", "gust"]
    assert (Path(code.__file__ or "").parent / "out" / "table.csv").exists()


@pytest.mark.full
def test_each_law_acts(code: ModuleType):
    """Worlds with a law and without it differ after a frame of the batch."""
    vary = {
        "balloon.law.magnet.strength": [20.0, 0.0, 20.0, 20.0],
        "balloon.law.stiffening.hardness": [3.0, 3.0, 0.0, 3.0],
        "law.gust.gust_velocity.0": [4.0, 4.0, 4.0, 0.0],
    }
    scene = code.scene.model_copy(update={"frames": 20})
    batch = Simulator(scene, "cpu", world_count=4, vary=vary, laws=code.laws)
    for _ in range(20):
        batch.step()
    points = batch.state.points.numpy()
    for without in points[1:]:
        assert np.abs(without - points[0]).max() > 1e-3


def test_the_mistake_is_said_as_it_stands_there(code: ModuleType):
    assert f"> {code.mistake}\n" in PAGE


def given_tables() -> str:
    """Return the arguments of laws of one's own, as the page has them."""
    tables = []
    for kind in ("particle", "spring", "face"):
        rows = [
            f"| `{each.name}` | {each.type} | {each.meaning.replace('|', chr(92) + '|')} |" for each in LAW_INPUTS[kind]
        ]
        tables.append("\n".join([f"| of a {kind} | type | |", "|---|---|---|", *rows]))
    return "\n\n".join(tables)


def test_the_tables_are_those_of_the_code():
    (tables,) = re.findall(r"<!-- given -->\n\n(.*?)\n\n<!-- end -->", PAGE, re.DOTALL)
    assert tables == given_tables()


def test_a_law_goes_in_with_one_file_and_its_name(tmp_path: Path):
    """A new law takes one file and its name in the list: in a copy of the source it acts, and tests cover it."""
    for folder in ("balloon_warp", "kernels", "scenes", "tests"):
        shutil.copytree(ROOT / folder, tmp_path / folder, ignore=shutil.ignore_patterns("__pycache__"))
    page = (ROOT / "docs" / "ARCHITECTURE.md").read_text(encoding="utf-8")
    (code,) = (each for each in re.findall(r"```python\n(.*?)```", page, re.DOTALL) if "CHARGE = Law(" in each)
    (tmp_path / "kernels" / "laws" / "charge.py").write_text(code, encoding="utf-8")
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
    files = [f"tests/{name}.py" for name in ("test_laws", "test_law_steps", "test_law_schedules")]
    tested = python("-m", "pytest", "-n", "0", *files, "-k", "charge and not block", "-v", "-p", "no:cacheprovider")
    assert tested.count("[charge] PASSED") >= 6
    assert re.search(r"in_every_schedule\[.*charge.*\] PASSED", tested)
