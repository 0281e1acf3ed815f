"""Commands and environments in processes of their own: examples run, and the fuzzing command loses no failure."""

import importlib.util
import json
import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from multiprocessing.process import BaseProcess
from pathlib import Path
from types import ModuleType
from typing import Any

import gymnasium
import numpy as np
import pytest
import warp as wp
from commands import status_of
from costs import nightly_but

from balloon_warp import InputError, WorkersLostError
from balloon_warp.benchmarks import kills, trust, viewer_nonsense
from balloon_warp.benchmarks.kills import KINDS, judge, kill_at_random
from balloon_warp.benchmarks.trust import Count, counted, efforts_of
from balloon_warp.benchmarks.worker_kills import kill_workers
from balloon_warp.learn import BalloonVectorEnv, SpreadVectorEnv, make_vec
from balloon_warp.learn.tasks import Target
from balloon_warp.studio.page.session import Session

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


GOOD = Count("good", 3, {"accepted": 3}, [])


def die() -> Count:
    os._exit(3)


def fail() -> Count:
    raise ZeroDivisionError("planted")


def harm() -> Count:
    return Count("harm", 5, {"same": 4, "damaged": 1}, ["1 damaged"])


def test_the_table_of_meshes_is_counted_and_all_kinds_are_tried():
    count = trust.bad_meshes()
    assert count.tried == sum(count.outcomes.values()) > 60
    assert not count.failures
    names = [trust._name(effort) for effort in efforts_of(trust.FULL)]
    assert names[0] == "bad meshes"
    assert {name.partition(" ")[0] for name in names[1:]} == {"mutated", "killed", "viewer"}
    assert sum(name.startswith("killed ") for name in names) == len(kills.KINDS) + 1


def test_what_dies_or_fails_is_a_failure_and_not_the_end():
    died, failed, harmed = counted([die, fail, harm])
    assert died.failures[0].startswith("BrokenProcessPool: ")
    assert failed.failures == ["ZeroDivisionError: planted"]
    assert harmed == harm()


@pytest.mark.parametrize("options", [[], ["--json"]])
@pytest.mark.parametrize(("counts", "status"), [([GOOD], 0), ([GOOD, harm()], 1)])
def test_a_failure_is_the_status(options: list[str], counts: list[Count], status: int, monkeypatch, capsys):
    monkeypatch.setattr(trust, "counted", lambda efforts: iter(counts))
    assert status_of("--quick", *options, main=trust.main) == status
    said = capsys.readouterr().out
    if options:
        assert json.loads(said)["failures"] == status
        assert json.loads(said)["counts"][-1]["what"] == counts[-1].what
    else:
        assert said.splitlines()[-1] == ("1 failed" if status else "nothing failed")
        assert ("FAILED: 1 damaged" in said) == bool(status)


def test_a_killed_worker_leaves_the_batch_of_one_process(tmp_path):
    assert kill_workers(1, tmp_path) == {"same": 1}


def test_nonsense_does_not_stop_the_viewer(monkeypatch):
    assert viewer_nonsense.send_nonsense(200) == {viewer_nonsense.WENT_ON: 1}
    monkeypatch.setattr(viewer_nonsense, "PATIENCE", 0.5)
    monkeypatch.setattr(Session, "run", lambda *_: None)
    monkeypatch.setattr(Session, "start", lambda *_: None)
    assert viewer_nonsense.send_nonsense(1) == {viewer_nonsense.STOOD_STILL: 1}


BEFORE, AFTER = {"a": b"old", "b": b"older"}, {"a": b"new", "b": b"newer"}


@pytest.mark.parametrize("kind", KINDS)
def test_a_killed_process_leaves_good_files(kind: str, tmp_path, monkeypatch):
    processes, start = [], kills._start_to_write

    def watch(*how: Any) -> BaseProcess:
        processes.append(start(*how))
        return processes[-1]

    monkeypatch.setattr(kills, "_start_to_write", watch)
    outcomes = kill_at_random(kind, 4, tmp_path)
    assert -signal.SIGKILL in [process.exitcode for process in processes]
    assert outcomes.total() - outcomes["resumed"] == 4
    assert outcomes["damaged"] == 0


@pytest.mark.parametrize(
    ("found", "outcome"),
    [
        (BEFORE, "kept"),
        (AFTER, "replaced"),
        ({"a": b"new", "b": b"older"}, "between"),
        ({"a": b"ne", "b": b"newer"}, "damaged"),
        ({"a": b"newer", "b": b"newer"}, "damaged"),
        ({"a": None, "b": b"older"}, "damaged"),
    ],
)
def test_damage_is_seen(found: dict[str, bytes | None], outcome: str):
    assert judge(found, BEFORE, AFTER) == outcome


WORLDS, STEPS = 5, 7


class Brief(Target):
    """Task with episodes of four steps."""

    most_steps = 4


def actions_of(step: int, worlds: int = WORLDS) -> Any:
    """Return actions that differ by world and step."""
    rows = [np.random.default_rng((world, step)).uniform(-1.0, 1.0, 3) for world in range(worlds)]
    return np.array(rows, dtype=np.float32)


def returns_by_policy(env: BalloonVectorEnv, steps: int, scale: float) -> Any:
    """Return the sum of each world's rewards, by the task's own policy, and the process that found it."""
    observations, _ = env.reset(seed=3)
    sums = np.zeros(env.num_envs)
    for _ in range(steps):
        observations, rewards, *_ = env.step(scale * env.task.policy(observations))
        sums += rewards
    return sums, os.getpid()


def end_yourself(env: BalloonVectorEnv) -> None:
    """End the process without a word, if it has the first world."""
    if env.simulator.starts.first_world == 0:
        os._exit(3)
    time.sleep(60.0)


@pytest.fixture(scope="module")
def spread() -> Iterator[SpreadVectorEnv]:
    env = make_vec(Brief(), WORLDS, workers=2, autoreset_mode="SameStep")
    yield env
    env.close()


def test_worlds_have_the_bits_of_a_single_process(spread: SpreadVectorEnv):
    whole = make_vec(Brief(), WORLDS, device="cpu", autoreset_mode="SameStep")
    assert [len(worlds) for worlds in spread.parts] == [2, 3]
    first = [env.reset(seed=11)[0] for env in (whole, spread)]
    np.testing.assert_array_equal(*first)
    for step in range(STEPS):
        (*arrays, info), (*others, other_info) = (env.step(actions_of(step)) for env in (whole, spread))
        for array, other in zip(arrays, others, strict=True):
            np.testing.assert_array_equal(other, array)
            assert other.dtype == array.dtype
        np.testing.assert_array_equal(other_info["final_obs"], info["final_obs"])
        np.testing.assert_array_equal(other_info["cause"], info["cause"])
    mask = np.array([0, 1, 0, 0, 1])
    again = [env.reset(options={"reset_mask": mask})[0] for env in (whole, spread)]
    np.testing.assert_array_equal(*again)


def test_a_policy_sits_in_each_process(spread: SpreadVectorEnv):
    whole = make_vec(Brief(), WORLDS, device="cpu", autoreset_mode="SameStep")
    told = spread.on_each(returns_by_policy, STEPS, 0.5)
    np.testing.assert_array_equal(np.concatenate([sums for sums, _ in told]), returns_by_policy(whole, STEPS, 0.5)[0])
    assert len({os.getpid(), *(process for _, process in told)}) == 3
    steps = 3
    assert spread.on_each(lambda env: env.num_envs * steps) == [6, 9]  # a closure travels, too


def is_gone(process: int, seconds: float = 10.0) -> bool:
    """Return whether a process has ended, or does so soon."""
    until = time.monotonic() + seconds
    while time.monotonic() < until:
        try:
            os.kill(process, 0)
        except ProcessLookupError:
            return True
        time.sleep(0.05)
    return False


def test_a_process_that_ends_ends_all():
    env = make_vec(Brief(), 2, workers=2)
    processes = env.on_each(lambda _: os.getpid())
    with pytest.raises(WorkersLostError, match=r"workers 2: process 0 ended"):
        env.on_each(end_yourself)
    assert all(is_gone(process) for process in processes)


def test_what_a_function_raises_is_raised_here_and_ends_all():
    """Gymnasium makes such an environment by its name."""
    env: Any = gymnasium.make_vec("BalloonWarp/Target-v0", num_envs=2, workers=2)
    assert isinstance(env, SpreadVectorEnv)
    processes = env.on_each(lambda _: os.getpid())

    def fail(env: BalloonVectorEnv) -> None:
        raise ValueError(f"world {env.simulator.starts.first_world}")

    with pytest.raises(ValueError, match=r"world [01]"):
        env.on_each(fail)
    assert all(is_gone(process) for process in processes)
    with pytest.raises(WorkersLostError, match=r"workers 2: the processes have ended"):
        env.step(np.zeros((2, 3)))


SCRIPT = """
import os, time
from balloon_warp.learn import make_vec

def wait(env):
    os.write(1, b"waits\\n")
    time.sleep(600)

if __name__ == "__main__":
    env = make_vec("Target", 2, workers=2)
    print("started", *env.on_each(lambda env: os.getpid()), flush=True)
    env.on_each(wait)
"""


def test_processes_are_gone_after_the_one_that_started_them(tmp_path):
    """SIGKILL leaves the parent no time to end them, and a function keeps them busy."""
    (tmp_path / "wait.py").write_text(SCRIPT)
    with subprocess.Popen([sys.executable, tmp_path / "wait.py"], stdout=subprocess.PIPE, text=True) as script:
        assert script.stdout is not None
        lines = iter(script.stdout.readline, "")
        processes = next([int(each) for each in line.split()[1:]] for line in lines if line.startswith("started"))
        for _ in processes:
            assert next(line for line in lines if line.startswith("waits"))
        assert len(processes) == 2
        script.send_signal(signal.SIGKILL)
    assert all(is_gone(process) for process in processes)


class Local:
    """Scope of a class that no other process finds."""

    def task(self) -> Target:
        class Hidden(Target):
            pass

        return Hidden()


MISTAKES = {
    "a device": ({"workers": 1, "device": "cpu"}, r"device: cannot be given with gpus or workers"),
    "worlds": ({"workers": 1, "num_envs": 0}, r"num_envs: must be a whole number of at least 1 \(got 0\)"),
    "a schedule": ({"workers": 1, "num_envs": 1, "schedule": "fast"}, r"schedule fast: no such schedule"),
    "a task": ({"workers": 1, "num_envs": 1, "task": Local().task()}, r"task: cannot be sent to a process"),
}


@pytest.mark.parametrize(("options", "message"), MISTAKES.values(), ids=MISTAKES)
def test_bad_input_is_told_in_a_sentence(options: dict[str, Any], message: str):
    with pytest.raises(InputError, match=message):
        make_vec(**{"task": "Target", "num_envs": 2, **options})


def test_actions_and_masks_are_checked_before_they_are_sent(spread: SpreadVectorEnv):
    with pytest.raises(InputError, match=r"actions: expected shape \(5, 3\) \(got \(2, 3\)\)"):
        spread.step(np.zeros((2, 3)))
    with pytest.raises(InputError, match=r"reset: expected a value for each world, of shape \(5,\) \(got \(2,\)\)"):
        spread.reset(options={"reset_mask": [0, 1]})
    spread.step(actions_of(0))  # it goes on


@pytest.mark.skipif(wp.get_cuda_device_count() < 2, reason="needs two GPUs")
def test_two_gpus_have_the_bits_of_one():
    """Tensors of a policy stay on its GPU."""
    torch = pytest.importorskip("torch")
    one, two = make_vec(Brief(), 300, device="cuda:0"), make_vec(Brief(), 300, gpus=2, output="torch")
    np.testing.assert_array_equal(one.reset(seed=5)[0], two.reset(seed=5)[0])
    for step in range(STEPS):
        ours, theirs = (env.step(actions_of(step, 300)) for env in (one, two))
        for array, other in zip(ours[:4], theirs[:4], strict=True):
            np.testing.assert_array_equal(array, other)

    def observe(env: BalloonVectorEnv) -> tuple[str, bool]:
        observations, _ = env.reset(seed=5)
        return os.environ["CUDA_VISIBLE_DEVICES"], isinstance(observations, torch.Tensor) and observations.is_cuda

    told = two.on_each(observe)
    assert len({name for name, _ in told}) == 2
    assert all(is_tensor for _, is_tensor in told)
    two.close()
