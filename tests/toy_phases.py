"""Phases without any physics, lists of them, and their NumPy references."""

from collections.abc import Callable
from itertools import pairwise
from typing import Any

import numpy as np
import warp as wp

from balloon_warp.kernels.algebra import dot_product
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.phase import Look, Phase, phase
from balloon_warp.kernels.tables import Tables

Values = dict[str, np.ndarray]


@phase("particle", {"seen": wp.vec3})
def look_aside(features: Features, look: Look) -> Any:
    at = look.at

    @wp.func
    def look_aside(t: Tables, points: Any, particle: wp.int32):  # pyright: ignore[reportGeneralTypeIssues]
        return at(points, (particle + 5) % t.particles.balloon.shape[0])

    return look_aside


@phase("particle", {"point": wp.vec3})
@wp.func
def follow(point: Any, seen: Any):
    return 0.75 * point + 0.25 * seen


@phase("particle", {"velocity": wp.vec3, "point": wp.vec3})
@wp.func
def trade(point: wp.vec3, velocity: wp.vec3):
    return point, velocity


@phase("particle", {"total": wp.vec3}, sums=True)
@wp.func
def add(point: wp.vec3):
    return point


@phase("balloon", {"half": wp.vec3})
@wp.func
def halve(total: wp.vec3):
    return 0.5 * total


@phase("particle", {"twice": wp.vec3}, light=True)
@wp.func
def double(half: wp.vec3):
    return 2.0 * half


@phase("particle", {"velocity": wp.vec3})
@wp.func
def heed(velocity: Any, twice: Any):
    return 0.5 * velocity + 0.125 * twice


@phase("particle", {"trace": float}, keeps={"trace": 1.0})
@wp.func
def remember(trace: Any, point: Any, velocity: Any):
    return 0.5 * trace + dot_product(point, velocity)


@phase("particle", {"seen": wp.vec3})
@wp.func
def look_at_traces(t: Tables, traces: Any, particle: wp.int32):  # pyright: ignore[reportGeneralTypeIssues]
    return wp.vec3(traces[(particle + 5) % t.particles.balloon.shape[0]], 0.0, 1.0)


@phase("face", {"height": float}, keeps={"height": 2.0})
def rise(features: Features, look: Look) -> Any:
    at = look.at

    @wp.func
    def rise(t: Tables, points: Any, face: wp.int32, height: float):  # pyright: ignore[reportGeneralTypeIssues]
        return 0.5 * height + at(points, t.faces.particles[t.faces.offsets[face]])[1]

    return rise


KEEPING: tuple[Phase, ...] = (remember, rise)


def sums_of(points: np.ndarray, offsets: np.ndarray) -> np.ndarray:
    """Return the sums of each balloon, shape (worlds, balloons, 3)."""
    return np.stack([points[:, a:b].sum(axis=1) for a, b in pairwise(offsets)], axis=1)


def by_numpy(name: str, have: Values, offsets: np.ndarray, first: np.ndarray) -> None:
    """Return the result of a phase for all items at once."""

    def seen_traces() -> np.ndarray:
        trace = np.roll(have["trace"], -5, axis=1)
        return np.stack([trace, np.zeros_like(trace), np.ones_like(trace)], axis=-1)

    each: dict[str, Callable[[], Values]] = {
        "look_aside": lambda: {"seen": np.roll(have["point"], -5, axis=1)},
        "follow": lambda: {"point": 0.75 * have["point"] + 0.25 * have["seen"]},
        "trade": lambda: {"velocity": have["point"], "point": have["velocity"]},
        "remember": lambda: {"trace": 0.5 * have["trace"] + (have["point"] * have["velocity"]).sum(axis=-1)},
        "look_at_traces": lambda: {"seen": seen_traces()},
        "rise": lambda: {"height": 0.5 * have["height"] + have["point"][:, first, 1]},
        "add": lambda: {"total": sums_of(have["point"], offsets)},
        "halve": lambda: {"half": 0.5 * have["total"]},
        "heed": lambda: {"velocity": 0.5 * have["velocity"] + 0.25 * np.repeat(have["half"], np.diff(offsets), axis=1)},
    }
    have |= each[name]()


LISTS: tuple[tuple[Phase, ...], ...] = (
    (look_aside, follow),
    (look_aside, trade, follow),
    (trade, look_aside, follow, look_aside, follow),
    (add, halve, double, heed, trade),
    (look_aside, follow, add, halve, double, heed, look_aside, trade, follow),
    (look_aside, add, halve, follow, double, heed, add, halve, trade, heed, follow),
    (remember, look_at_traces, follow, trade),
    (look_at_traces, remember, follow, rise, look_aside, follow),
)
