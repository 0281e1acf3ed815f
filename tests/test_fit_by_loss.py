"""Minima of a loss: against throws with closed forms, and the checks of losses."""

import re
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from meshes import quad_sphere

import balloon_warp as bw
from balloon_warp.fitting.by_loss import least_loss
from balloon_warp.fitting.together import minima_together

BALL = bw.Balloon(mesh=quad_sphere(2), mass=0.5, damping=0.0, inflation=bw.Inflation(pressure=0.0))
FLIGHT = bw.Scene(balloon=[BALL], frames=12, substeps=8, gravity=9.81)
STEP, COUNT = 1.0 / 60.0 / 8.0, 12 * 8
FALLEN = 9.81 * STEP**2 * COUNT * (COUNT + 1) / 2
THROW = {"balloon.velocity.0": (-3.0, 4.0), "balloon.velocity.1": (-2.0, 6.0)}


@pytest.mark.full
def test_a_throw_hits_its_target():
    """A fitted throw hits its target along symplectic Euler's parabola: v = (way + fall) / time."""
    target = np.array([0.3, 0.2, 0.0])
    found = bw.fit(FLIGHT, of=THROW, loss=bw.losses.distance(target), starts=4, device="cpu")
    assert found.values["balloon.velocity.0"] == pytest.approx(0.3 / (STEP * COUNT), rel=1e-3)
    assert found.values["balloon.velocity.1"] == pytest.approx((0.2 + FALLEN) / (STEP * COUNT), rel=1e-3)
    assert found.loss < 1e-8
    assert found.starts.shape == (4,)
    assert (np.diff(found.starts) >= 0.0).all()
    assert found.starts[-1] < 1e-6  # a parabola has one minimum, which all starts find


def test_a_start_that_blows_up_leaves_the_others_alone():
    """A start that blows up does not disturb the others, which are then simulated one by one."""

    def derive(of: list[str], vary: dict[str, np.ndarray], world_count: int) -> Any:
        if (vary["drag"] > 0.7).any():
            raise bw.BlowUpError("world 0 blew up")
        off = vary["drag"] - 0.3
        return SimpleNamespace(loss=off**2, gradients={"drag": 2.0 * off})

    first = np.linspace(0.1, 0.9, 6)[:, None]
    found = least_loss(derive, {"drag": (0.0, 1.0)}, first, 9, lambda stage: None)
    assert found.values["drag"] == pytest.approx(0.3, abs=1e-5)
    assert np.isinf(found.starts).sum() == 2
    assert found.starts[3] < 1e-9


@pytest.mark.full
def test_a_value_without_influence_is_named_and_left_where_it_began():
    """A parameter without influence is named and keeps its start: nothing pushes the ball along z."""
    said: list[str] = []
    of = {"balloon.velocity.0": (-3.0, 4.0), "balloon.velocity.2": (-1.0, 1.0)}
    found = bw.fit(FLIGHT, of=of, loss=along_x, starts=1, device="cpu", on_stage=said.append)
    assert found.without_influence == ("balloon.velocity.2",)
    assert "the loss does not depend on balloon.velocity.2 at any start" in said
    assert found.values["balloon.velocity.0"] == pytest.approx(0.3 / (STEP * COUNT), rel=1e-3)
    with pytest.raises(bw.InputError, match=r"depends on none of the values .* balloon\.velocity\.2;"):
        bw.fit(FLIGHT, of={"balloon.velocity.2": (-1.0, 1.0)}, loss=along_x, starts=1, device="cpu")


def along_x(moved: bw.Trajectories) -> tuple[Any, dict[str, Any]]:
    """Return the squared distance of the center from 0.3 m along x in the end, and its derivatives."""
    points = moved.points[0]
    off = points[..., -1, :, 0].mean(axis=-1) - 0.3
    slopes = np.zeros(points.shape)
    slopes[..., -1, :, 0] = (2.0 * off / points.shape[-2])[..., None]
    return off**2, {"points": [slopes]}


LOSSES = {
    "distance": bw.losses.distance((0.1, 0.2, 0.3)),
    "distance of all frames": bw.losses.distance((0.1, 0.2, 0.3), frame=None),
    "distance of particles": bw.losses.distance(quad_sphere(2).points + 0.1, frame=3),
    "height": bw.losses.height(0.5),
    "height of all frames": bw.losses.height(0.5, frame=None),
    "volume": bw.losses.volume(3.0, frame=None),
    "pressure": bw.losses.pressure(10.0, frame=2),
}
LOSSES["together"] = bw.losses.together(list(LOSSES.values()), [0.5 + number for number in range(len(LOSSES))])


@pytest.mark.parametrize("name", LOSSES)
@pytest.mark.parametrize("worlds", [1, 2])
def test_the_derivatives_of_a_loss_are_its_slopes(name: str, worlds: int):
    """Derivatives by everything that a loss sees agree with central differences along a random direction, which are
    exact for quadratic losses."""
    moved = bw.simulate(FLIGHT.model_copy(update={"frames": 4}), world_count=worlds, device="cpu")
    rng, loss = np.random.default_rng(1), LOSSES[name]
    _, slopes = loss(moved)
    sides, along = [], np.zeros(worlds)
    ways = {key: rng.normal(size=np.shape(array[0] if key == "points" else array)) for key, array in slopes.items()}
    for key, way in ways.items():
        array = slopes[key][0] if key == "points" else slopes[key]
        along += (array * way).reshape(worlds, -1).sum(axis=1)
    for sign in (1e-3, -1e-3):
        changed: dict[str, Any] = {}
        for key, way in ways.items():
            told = getattr(moved, key)
            changed[key] = [told[0].astype(float) + sign * way] if key == "points" else told.astype(float) + sign * way
        seen: Any = Seen(moved, changed)
        sides.append(np.reshape(loss(seen)[0], worlds))
    np.testing.assert_allclose(along, (sides[0] - sides[1]) / 2e-3, rtol=1e-6)


class Seen:
    """Trajectories with some tracks in place of theirs."""

    def __init__(self, moved: bw.Trajectories, tracks: dict[str, Any]):
        self._moved, self._tracks = moved, tracks

    def __getattr__(self, name: str) -> Any:
        return self._tracks[name] if name in self._tracks else getattr(self._moved, name)


def test_starts_are_asked_together():
    """Starts share each batch: all find the bottom of a bowl from its rim, and each evaluation is of all of them."""
    asked = []

    def ask(places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        asked.append(places.shape)
        return ((places - 0.4) ** 2).sum(axis=1), 2.0 * (places - 0.4)

    first = np.random.default_rng(0).uniform(size=(5, 2))
    places, count = minima_together(ask, first, 20, lambda number, loss: None)
    np.testing.assert_allclose(places, 0.4, atol=1e-6)
    assert set(asked) == {(5, 2)}
    assert count == len(asked)


REFUSED: dict[str, tuple[dict[str, Any], str]] = {
    "neither": ({}, "fit: expected either measured data and `free`, or a `loss` and `of`"),
    "no bounds": ({"loss": bw.losses.height(1.0)}, "of: expected at least one path"),
    "wrong bounds": ({"loss": bw.losses.height(1.0), "of": {"gravity": (2.0, 1.0)}}, "of: gravity: expected a lowest"),
    "unknown": ({"loss": bw.losses.height(1.0), "of": {"balloon.mas": (1.0, 2.0)}}, "unknown field"),
    "a balloon": ({"loss": bw.losses.height(1.0, balloon=2), "of": THROW}, "balloon: expected a number below 1"),
    "a frame": ({"loss": bw.losses.height(1.0, frame=99), "of": THROW}, "frame: expected a number from -13 to 12"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_cannot_be_fitted_is_refused_in_a_sentence(case: str):
    more, sentence = REFUSED[case]
    with pytest.raises(bw.InputError, match=re.escape(sentence)):
        bw.fit(FLIGHT, device="cpu", starts=1, **more)


def test_a_loss_that_raises_ends_all_starts():
    calls = []

    def broken(moved: bw.Trajectories) -> Any:
        calls.append(1)
        if len(calls) == 3:
            raise RuntimeError("no more")
        return bw.losses.height(3.0)(moved)

    with pytest.raises(RuntimeError, match="no more"):
        bw.fit(FLIGHT, of={"balloon.velocity.1": (-2.0, 6.0)}, loss=broken, starts=3, device="cpu")


def test_a_target_of_another_shape_is_refused():
    with pytest.raises(bw.InputError, match="distance: target: expected a place, three numbers"):
        bw.losses.distance((1.0, 2.0))
