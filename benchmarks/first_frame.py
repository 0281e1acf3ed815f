"""Time to the first frame: a process of its own imports, loads, compiles and simulates it.

The time that the process takes to end is not counted.
"""

import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from statistics import median

import warp as wp

import balloon_warp
from balloon_warp.benchmarks.cases import FirstFrameCase
from balloon_warp.benchmarks.result import Result

REPEATS = 3
SIMULATE = """
import sys
import balloon_warp as bw
from balloon_warp.system.warp_setup import quiet_warp

quiet_warp()
simulator = bw.Simulator(bw.load_scene(sys.argv[1]), sys.argv[2])
simulator.step()
frame = simulator.read_frame()
print(simulator.schedule.name, sum(len(points) for points in frame.points), flush=True)
"""


def measure_first_frame(case: FirstFrameCase, device: wp.Device) -> Result:
    """Return the median of some processes, with a new folder as kernel cache, filled beforehand for a warm start.

    Raises:
        subprocess.CalledProcessError: a process failed.
    """
    seconds, printed = [], ""
    with tempfile.TemporaryDirectory(prefix="balloon-warp-") as folder:
        _simulate(case, device, folder)  # Python keeps compiled modules, too, as of an installed package
        for number in range(REPEATS):
            elapsed, printed = _simulate(case, device, str(Path(folder) / str(number)) if case.cold else folder)
            seconds.append(elapsed)
    schedule, particles = printed.split()
    return Result(
        case=case.name,
        device=str(device),
        schedule=schedule,
        worlds=1,
        particles=int(particles),
        rate=median(seconds),
    )


def _simulate(case: FirstFrameCase, device: wp.Device, cache: str) -> tuple[float, str]:
    """Seconds until a process has its first frame, and its output then."""
    imported = str(Path(balloon_warp.__path__[0]).parent)
    path = os.pathsep.join(filter(None, [imported, os.environ.get("PYTHONPATH")]))
    environment = {**os.environ, "WARP_CACHE_PATH": cache, "PYTHONPATH": path}
    environment.pop("PYTHONDONTWRITEBYTECODE", None)
    command = [sys.executable, "-c", SIMULATE, case.scene, str(device)]
    began = time.perf_counter()
    with subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout
        printed = process.stdout.readline()
        elapsed = time.perf_counter() - began
    if process.returncode:
        raise subprocess.CalledProcessError(process.returncode, command)
    return elapsed, printed
