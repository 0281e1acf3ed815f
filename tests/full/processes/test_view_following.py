"""Cameras that follow balloons, with keys and drawing in threads of their own."""

import threading
import time
from contextlib import nullcontext

import numpy as np
import pytest

pytest.importorskip("viser")

from balloon_warp.viewer.following import Follower


class SlowCamera:
    """Camera whose place takes a while to be read and set, so that threads race."""

    look_at = (0.0, 0.0, 0.0)

    def __init__(self) -> None:
        self._position = (0.0, 0.0, 4.0)

    @property
    def position(self) -> tuple[float, ...]:
        time.sleep(0.05)
        return self._position

    @position.setter
    def position(self, place: tuple[float, ...]) -> None:
        time.sleep(0.1)
        self._position = place


class Window:
    client_id = 7

    def __init__(self) -> None:
        self.camera = SlowCamera()

    atomic = staticmethod(nullcontext)


CENTER = np.array([0.0, 3.0, 0.0])


def together(*calls) -> None:
    threads = [threading.Thread(target=call) for call in calls]
    for thread in threads:
        thread.start()
        time.sleep(0.02)
    for thread in threads:
        thread.join()


def test_two_presses_at_once_follow_and_stay():
    follower, window = Follower(), Window()
    together(*[lambda: follower.toggle(window, CENTER, 2.0)] * 2)
    assert not follower.follows(window)
    np.testing.assert_allclose(window.camera.look_at, CENTER)
    np.testing.assert_allclose(window.camera.position, CENTER + [0.0, 0.0, 2.0])


def test_a_press_while_it_is_drawn_ends_following():
    follower, window = Follower(), Window()
    follower.toggle(window, CENTER, 2.0)
    together(lambda: follower.follow({7: window}, CENTER + 1.0), lambda: follower.toggle(window, CENTER, 2.0))
    assert not follower.follows(window)


def test_a_window_that_closed_is_forgotten():
    follower, window = Follower(), Window()
    follower.toggle(window, CENTER, 2.0)
    follower.follow({}, CENTER)
    assert not follower.follows(window)
