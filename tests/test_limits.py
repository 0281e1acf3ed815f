"""Memory limit of a process, where that is less than the machine has."""

import subprocess
import sys
from pathlib import Path

import pytest
from typer.testing import CliRunner

from balloon_warp.cli.app import app
from balloon_warp.errors import InputError
from balloon_warp.model.state import Limit, least_limit

GIB = 2**30


def write(root: Path, path: str, text: str) -> None:
    (root / path).parent.mkdir(parents=True, exist_ok=True)
    (root / path).write_text(text)


def status(root: Path, gib: float) -> None:
    write(root, "proc/self/status", f"Name:\tpython3\nVmRSS:\t  {int(gib * 2**20)} kB\nThreads:\t1\n")


@pytest.mark.parametrize("limited", ["job/task", "job", ""])
def test_a_cgroup_of_version_2_and_those_it_is_in(tmp_path: Path, limited: str):
    """The limit of a cgroup is its maximum less the memory in use, not counting inactive files."""
    write(tmp_path, "proc/self/cgroup", "0::/job/task\n")
    for group in ("job/task", "job", ""):
        folder = f"sys/fs/cgroup/{group}"
        write(tmp_path, f"{folder}/memory.max", f"{4 * GIB}\n" if group == limited else "max\n")
        write(tmp_path, f"{folder}/memory.current", f"{3 * GIB}\n")
        write(tmp_path, f"{folder}/memory.stat", f"anon {GIB}\ninactive_file {GIB // 2}\nactive_file {GIB}\n")
    assert least_limit(tmp_path, {}) == Limit("the cgroup's memory.max", 3 * GIB // 2)


def test_a_cgroup_of_version_1(tmp_path: Path):
    write(tmp_path, "proc/self/cgroup", "9:cpu,cpuacct:/a\n7:memory:/a\n1:name=systemd:/a\n0::/a\n")
    folder = "sys/fs/cgroup/memory/a"
    write(tmp_path, f"{folder}/memory.limit_in_bytes", f"{2 * GIB}\n")
    write(tmp_path, f"{folder}/memory.usage_in_bytes", f"{GIB}\n")
    write(tmp_path, f"{folder}/memory.stat", f"inactive_file 5\ntotal_inactive_file {GIB // 4}\n")
    assert least_limit(tmp_path, {}) == Limit("the cgroup's memory.limit_in_bytes", 5 * GIB // 4)


def test_a_container_sees_its_own_group_as_the_root(tmp_path: Path):
    """A container sees its own group as the root: the path in the process is the host's, and does not exist."""
    write(tmp_path, "proc/self/cgroup", "0::/system.slice/docker-1234.scope\n")
    write(tmp_path, "sys/fs/cgroup/memory.max", f"{GIB}\n")
    write(tmp_path, "sys/fs/cgroup/memory.current", f"{GIB // 4}\n")
    assert least_limit(tmp_path, {}) == Limit("the cgroup's memory.max", 3 * GIB // 4)


def test_a_job_of_slurm(tmp_path: Path):
    status(tmp_path, 0.5)
    node, cpu = {"SLURM_MEM_PER_NODE": "4096"}, {"SLURM_MEM_PER_CPU": "1024", "SLURM_CPUS_ON_NODE": "3"}
    assert least_limit(tmp_path, node) == Limit("SLURM_MEM_PER_NODE", 7 * GIB // 2)
    assert least_limit(tmp_path, cpu) == Limit("SLURM_MEM_PER_CPU", 5 * GIB // 2)
    assert least_limit(tmp_path, node | cpu) == Limit("SLURM_MEM_PER_CPU", 5 * GIB // 2)


def test_what_makes_no_sense_or_asks_for_all_of_a_node_is_no_limit(tmp_path: Path):
    write(tmp_path, "proc/self/cgroup", "0::/a\n")
    write(tmp_path, "sys/fs/cgroup/a/memory.max", "much\n")
    assert least_limit(tmp_path, {"SLURM_MEM_PER_NODE": "many", "SLURM_MEM_PER_CPU": "1024"}) is None
    assert least_limit(tmp_path, {"SLURM_MEM_PER_NODE": "0"}) is None  # `--mem=0`


@pytest.mark.skipif(sys.platform == "win32", reason="has no ulimit")
@pytest.mark.parametrize(("option", "name"), [("-v", "RLIMIT_AS"), ("-d", "RLIMIT_DATA")])
@pytest.mark.parametrize("command", ["inspect squirrel_inflate", "run squirrel_inflate"])
def test_a_ulimit_without_room_for_the_libraries_is_refused(
    command: str, option: str, name: str, monkeypatch: pytest.MonkeyPatch
):
    """USD ended in a segmentation fault, or waited for ever for a thread that did not start."""
    import resource

    asked, before = getattr(resource, name), resource.getrlimit
    monkeypatch.setattr(resource, "getrlimit", lambda each: (300000 * 1024, -1) if each == asked else before(each))
    said = CliRunner().invoke(app, command.split())
    assert str(said.exception).startswith(f"ulimit {option}: 300000 is less than the libraries take on this machine")
    assert isinstance(said.exception, InputError)
    monkeypatch.setattr(resource, "getrlimit", lambda each: (2**36, 2**36))
    assert CliRunner().invoke(app, ["scenes"]).exit_code == 0


@pytest.mark.full
@pytest.mark.skipif(sys.platform == "win32", reason="has no ulimit")
def test_ulimit_is_said_and_refuses_what_does_not_fit():
    program = """
import resource
import balloon_warp as bw
bw.Simulator("latex_inflate", "cpu")
resource.setrlimit(resource.RLIMIT_AS, (6 * 2**30, resource.getrlimit(resource.RLIMIT_AS)[1]))
try:
    bw.Simulator("latex_inflate", "cpu", world_count=1_000_000)
except bw.InputError as refusal:
    print(refusal)
"""
    result = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=120)
    assert "GiB to spare within ulimit -v, enough for" in result.stdout, result.stderr
