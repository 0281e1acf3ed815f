"""Fits that are stopped and resumed."""

import numpy as np
import pytest
from test_fit import FREE, falling
from typer.testing import CliRunner

import balloon_warp as bw
from balloon_warp.cli.app import app
from balloon_warp.errors import InputError, StoppedError


def test_a_fit_that_was_stopped_goes_on(tmp_path):
    """A resumed fit finds the same values without repeating simulations, and drops a record that a kill cut short."""
    moved = bw.simulate(falling(), device="cpu")
    seen = {"times": moved.times[1:], "points": moved.points[0][1:], "noise": 1e-3}
    kept, asked = tmp_path / "fit.progress", {"free": FREE, "starts": 2, "rounds": 3, "device": "cpu"}

    def stop(stage: str) -> None:
        if stage.startswith("round 3"):
            raise KeyboardInterrupt

    with pytest.raises(InputError, match="has no fit to --resume"):
        bw.fit(falling(), seen, **asked, progress=kept, resume=True)
    with pytest.raises(KeyboardInterrupt):
        bw.fit(falling(), seen, **asked, progress=kept, on_stage=stop)
    kept.write_bytes(kept.read_bytes()[:-9])
    with pytest.raises(InputError, match="has another fit; --resume needs"):
        bw.fit(falling(), seen, **{**asked, "starts": 3}, progress=kept, resume=True)
    told: list[str] = []
    resumed = bw.fit(falling(), seen, **asked, progress=kept, resume=True, on_stage=told.append)
    assert "resuming after round 2" in told
    assert resumed.values == bw.fit(falling(), seen, **asked).values
    assert not kept.exists()


@pytest.mark.full
def test_ctrl_c_says_how_to_go_on(tmp_path, monkeypatch):
    np.savez(tmp_path / "volumes.npz", times=[0.1], volumes=[1.0])
    words = ["fit", str(tmp_path / "volumes.npz"), "knot", "--free", "balloon.damping=0.1:2", "--device", "cpu"]

    def stop(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("balloon_warp.fitting.by_data.search", stop)
    said = CliRunner().invoke(app, words)
    assert isinstance(said.exception, StoppedError)
    assert f"--resume continues from {tmp_path / 'volumes.progress'}" in str(said.exception)
