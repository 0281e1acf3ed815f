"""Forked children of a process that has simulated: they simulate, too, and never wait for their parent's threads."""

import os
import subprocess
import sys
import textwrap
from pathlib import Path

import pytest

SECONDS = 240
"""Time after which a child counts as hanging"""
BEFORE = """
    import multiprocessing, os, sys
    import balloon_warp as bw
    from meshes import quad_sphere
    from balloon_warp.scene import Balloon, Scene

    def pressed(pressure, frames=2):
        inflation = {"kind": "pressure", "pressure": pressure}
        return Scene(balloon=[Balloon(mesh=quad_sphere(2), inflation=inflation)], frames=frames)

    def height(pressure):
        simulator = bw.Simulator(pressed(pressure), device="cpu")
        *_, last = simulator.run()
        return float(last.points[0][:, 1].max())
"""
CHILDREN = {
    "a pool, while a kernel compiles": """
        os.environ["WARP_CACHE_PATH"] = sys.argv[1]  # which has no kernels: Warp is not there yet
        bw.Simulator(pressed(1.0), device="cpu")
        with multiprocessing.get_context("fork").Pool(2) as pool:
            heights = pool.map(height, [1.0, 2.0])
        assert heights == [height(1.0), height(2.0)]
    """,
    "a simulator of its parent": """
        simulator = bw.Simulator(pressed(1.0), device="cpu", world_count=32)
        simulator.step()
        child = os.fork()
        if not child:
            simulator.step()
            os._exit(0)
        assert os.waitpid(child, 0)[1] == 0
    """,
    "a batch after a batch": """
        values = {"balloon.mass": [1.0, 2.0]}
        bw.run_batch(pressed(1.0), sys.argv[1] + "/parent", 2, values, device="cpu")
        child = os.fork()
        if not child:
            bw.run_batch(pressed(1.0), sys.argv[1] + "/child", 2, values, device="cpu")
            os._exit(0)
        assert os.waitpid(child, 0)[1] == 0
    """,
    "environments": """
        import gymnasium, balloon_warp.learn
        name = "BalloonWarp/Altitude-v0"
        environments = gymnasium.vector.AsyncVectorEnv([lambda: gymnasium.make(name)] * 2, context="fork")
        environments.reset(seed=1)
        environments.step(environments.action_space.sample())
        environments.close()
    """,
}


@pytest.mark.skipif(not hasattr(os, "fork"), reason="no forks here")
@pytest.mark.parametrize("children", CHILDREN)
def test_forked_children_simulate(children: str, tmp_path: Path):
    program = textwrap.dedent(BEFORE) + textwrap.dedent(CHILDREN[children])
    path = os.pathsep.join([str(Path(__file__).parents[2]), os.environ.get("PYTHONPATH", "")])
    command = [sys.executable, "-c", program, str(tmp_path)]
    subprocess.run(command, check=True, timeout=SECONDS, env={**os.environ, "PYTHONPATH": path})
