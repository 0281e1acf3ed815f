"""Page of an environment with `render_mode="human"`, without a browser: it is served, frames arrive, and it closes."""

import urllib.error
import urllib.request
from typing import Any
from unittest.mock import Mock

import gymnasium
import numpy as np
import pytest
from strangers import CAMERA, joined, say, wait_until

from balloon_warp import InputError, MissingExtraError
from balloon_warp.learn import make, make_vec
from balloon_warp.learn.registration import BalloonEnv
from balloon_warp.studio.page import view


@pytest.fixture
def opened(monkeypatch) -> list[str]:
    """Return the addresses that browsers are asked to open."""
    addresses: list[str] = []
    monkeypatch.setattr("balloon_warp.studio.page.page.webbrowser.open", addresses.append)
    return addresses


def test_a_page_shows_what_steps_and_closes_with_the_environment(opened: list[str], capsys):
    env = gymnasium.make("BalloonWarp/Target-v0", device="cpu", render_mode="human")
    bare: Any = env.unwrapped
    env.reset(seed=0)
    page = bare.onlooker
    assert opened == [page.address]
    assert f"world 0 is shown at {page.address}" in capsys.readouterr().err
    with urllib.request.urlopen(page.address) as answer:
        assert b"<html" in answer.read().lower()
    env.step(env.action_space.sample())  # nobody looks: nothing is drawn, and it is not slowed down
    before = page.layers._balloons[0].vertices.copy()
    arrived: list[bytes] = []
    with joined(page, arrived) as window:
        say(window, CAMERA)
        wait_until(lambda: page.server.get_clients(), "a window")
        for _ in range(3):
            there = len(arrived)
            env.step(env.action_space.sample())
            wait_until(lambda there=there: len(arrived) > there, "a frame")
        assert env.render() is None
        now = page.layers._balloons[0].vertices
        assert np.isfinite(now).all()
        assert (now != before).any()
    env.close()
    with pytest.raises(urllib.error.URLError):
        urllib.request.urlopen(page.address, timeout=5)
    with pytest.raises(InputError, match="the environment is closed"):
        env.step(env.action_space.sample())


def test_a_page_is_no_faster_than_real_time(opened: list[str], monkeypatch):
    waited: list[float] = []
    env = make_vec("Target", 2, device="cpu", render_mode="human")
    env.reset(seed=0)
    assert env.onlooker is not None
    monkeypatch.setattr("balloon_warp.studio.page.page.time.sleep", waited.append)
    monkeypatch.setattr("balloon_warp.studio.page.page.time.perf_counter", lambda: 0.0)
    monkeypatch.setattr(env.onlooker.server, "get_clients", lambda: {0: None})
    for _ in range(3):
        env.step(env.action_space.sample())
    seconds = env.task.frames * env.simulator.model.frame_seconds
    assert waited == pytest.approx([0.0, seconds, 2.0 * seconds])
    env.close()


def test_modes_are_listed_and_what_cannot_be_shown_is_told(monkeypatch):
    assert BalloonEnv.metadata["render_modes"] == ["human", "rgb_array"]
    with pytest.raises(InputError, match=r"render_mode: worlds in processes of their own have no page; expected"):
        make_vec("Target", 2, workers=1, render_mode="human")

    missing = Mock(side_effect=MissingExtraError("view needs viser"))
    monkeypatch.setattr(view, "_needing_viser", missing)
    env = make("Target", device="cpu", render_mode="human")
    with pytest.raises(MissingExtraError, match="view needs viser"):
        env.reset(seed=0)
