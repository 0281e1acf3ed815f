"""Velocities in a stage. That they are the derivatives of points is tested with each writer of stages, by
`motion.py`."""

from pathlib import Path

import numpy as np
from meshes import cube
from pxr import Usd, UsdGeom

from balloon_warp import Scene, Simulator, StageWriter
from balloon_warp.scene import Balloon


def test_a_stage_of_one_frame_shows_nothing_that_moves(tmp_path: Path):
    simulator = Simulator(Scene(balloon=[Balloon(mesh=cube())]), "cpu")
    simulator.step()
    with StageWriter(tmp_path / "one.usda", simulator.model) as stage:
        stage.write(simulator.read_frame())
    opened = Usd.Stage.Open(str(tmp_path / "one.usda"))
    velocities = UsdGeom.Mesh(opened.GetPrimAtPath("/World/mesh")).GetVelocitiesAttr()
    assert velocities.GetTimeSamples() == [1.0]
    np.testing.assert_array_equal(velocities.Get(1), np.zeros((8, 3)))
