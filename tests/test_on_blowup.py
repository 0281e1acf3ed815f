"""Outputs of a run that blows up."""

import numpy as np
import pytest
from meshes import cube
from pxr import Sdf, Usd

from balloon_warp.blow_ups import with_half_the_step
from balloon_warp.errors import BlowUpError, InputError
from balloon_warp.job import Summary, animate
from balloon_warp.scene import Balloon, Change, Inflation, Scene, Sphere, Stiffness, String

BURSTS = Inflation(k_normal=[(0.0, 1.0), (0.1, 1.0), (0.15, 9e11)])
"""stronger than any step is short, from frame 7 on"""
HOPELESS = Scene(
    balloon=[Balloon(mesh=cube(), inflation=BURSTS)], sphere=[Sphere(position=(0, 4, 0))], frames=12, faces=False
)
GAINS_ENERGY = Scene(
    balloon=[Balloon(mesh=cube(), mass=1.0, damping=50.0, stiffness=Stiffness(structural=3000.0))],
    string=[String(anchor=(0.0, -1.0, 0.0))],
    solver="forward_euler",
    substeps=3,
    frames=40,
)
"""too long a step for forward Euler, and so is its half, but not a quarter of it"""


def samples(layer: Sdf.Layer) -> dict[tuple[str, float], np.ndarray]:
    """Return the numbers that change with time, by the attribute's path and the time."""
    found, stage = {}, Usd.Stage.Open(layer)
    for path in [prim.GetPath() for prim in stage.Traverse()]:
        for prop in layer.GetPrimAtPath(path).properties:
            for time in layer.ListTimeSamplesForPath(prop.path):
                value = layer.QueryTimeSample(prop.path, time)
                if not isinstance(value, str):
                    found[str(prop.path), time] = np.array(value, dtype=np.float64)
    return found


@pytest.mark.full
def test_frozen_the_stage_ends_at_the_last_good_frame(device: str, tmp_path):
    warnings: list[str] = []
    how = {"device": device, "schedule": "gather", "checkpoint_seconds": 1e-9}
    summary = animate(HOPELESS, tmp_path / "a.usdc", on_blowup="freeze", on_warning=warnings.append, **how)
    assert [path.name for path in tmp_path.iterdir()] == ["a.usdc"]  # what was saved meanwhile is in it
    assert summary.frames == 6
    assert "blew up in frame 7, " in (summary.blow_up or "")
    assert warnings[-1].rpartition(". ")[2] == "The stage ends at frame 6, the last good one"
    layer = Sdf.Layer.FindOrOpen(str(tmp_path / "a.usdc"))
    assert layer.endTimeCode == 6
    found = samples(layer)
    assert all(np.isfinite(value).all() for value in found.values())
    assert {time for _, time in found} == set(range(7))
    animate(HOPELESS.model_copy(update={"frames": 6}), tmp_path / "b.usdc", device=device, schedule="gather")
    expected = samples(Sdf.Layer.FindOrOpen(str(tmp_path / "b.usdc")))
    assert found.keys() == expected.keys()
    for key, value in expected.items():
        np.testing.assert_array_equal(found[key], value)


@pytest.mark.full
def test_restarted_it_is_the_run_with_as_many_substeps_byte_by_byte(device: str, tmp_path):
    def run(name: str, scene: Scene, on_blowup: str, warnings: list[str]) -> Summary:
        """Run by a deterministic schedule."""
        options = {"device": device, "schedule": "gather", "on_blowup": on_blowup, "on_warning": warnings.append}
        return animate(scene, tmp_path / name, **options)

    warnings: list[str] = []
    summary = run("restarted.usdc", GAINS_ENERGY, "restart", warnings)
    assert (summary.restarts, summary.substeps, summary.frames, summary.blow_up) == (2, 12, 40, None)
    assert [sentence.rpartition(". ")[2] for sentence in warnings] == [
        f"It restarts with {substeps} substeps a frame" for substeps in (6, 12)
    ]
    scene = GAINS_ENERGY.model_copy(update={"substeps": summary.substeps})
    assert run("expected.usdc", scene, "stop", []).restarts == 0
    assert (tmp_path / "restarted.usdc").read_bytes() == (tmp_path / "expected.usdc").read_bytes()
    with pytest.raises(BlowUpError):
        run("longer.usdc", scene.model_copy(update={"substeps": summary.substeps // 2}), "stop", [])


@pytest.mark.full
def test_stopped_in_shorter_steps_it_goes_on_in_these(device: str, tmp_path):
    """A run resumed in shorter steps writes the same bytes; checkpoints of the longer steps are gone."""

    class StopError(Exception):
        pass

    frames: list[int] = []

    def stop(frame: int) -> None:
        frames.append(frame)
        if frames.count(5) == 3:
            raise StopError

    how = {"device": device, "schedule": "gather", "on_blowup": "restart"}
    animate(GAINS_ENERGY, tmp_path / "whole.usdc", **how)
    with pytest.raises(StopError):
        animate(GAINS_ENERGY, tmp_path / "out.usdc", checkpoint_seconds=1e-9, on_frame=stop, **how)
    assert not (tmp_path / "out.usdc.partial.old").exists()
    summary = animate(GAINS_ENERGY, tmp_path / "out.usdc", resume=True, **how)
    assert (summary.begin, summary.restarts, summary.substeps) == (4, 2, 12)
    assert (tmp_path / "out.usdc").read_bytes() == (tmp_path / "whole.usdc").read_bytes()


@pytest.mark.parametrize("on_blowup", ["stop", "restart"])
def test_where_it_ends_in_a_blow_up_the_old_stage_stays(on_blowup: str, tmp_path):
    (tmp_path / "a.usdc").write_text("old")
    with pytest.raises(
        BlowUpError, match="The 4 longer steps blew up as well" if on_blowup == "restart" else "less force helps"
    ):
        animate(HOPELESS, tmp_path / "a.usdc", device="cpu", on_blowup=on_blowup)
    assert [path.name for path in tmp_path.iterdir()] == ["a.usdc"]
    assert (tmp_path / "a.usdc").read_text() == "old"


def test_another_policy_is_refused_before_anything_runs(tmp_path):
    with pytest.raises(InputError, match=r"^--on-blowup pray: expected freeze, stop, restart$"):
        animate(HOPELESS, tmp_path / "a.usdc", on_blowup="pray")


def test_half_the_step_holds_for_what_the_scene_changes_it_to():
    changes = [
        Change(time=0.1, set={"substeps": 20, "gravity": 1.0}),
        Change(time=0.2, set={"substeps": "auto"}),
        Change(time=0.3, set={"gravity": 2.0}),
    ]
    halved = with_half_the_step(GAINS_ENERGY.model_copy(update={"change": changes}), 7)
    assert halved.substeps == 14
    assert [change.set for change in halved.change] == [
        {"substeps": 40, "gravity": 1.0},
        {"substeps": "auto"},
        {"gravity": 2.0},
    ]
