"""Snapshot of a session for drawing."""

from dataclasses import dataclass

from balloon_warp.frame import Frame
from balloon_warp.model import Model
from balloon_warp.scene import Scene


@dataclass(frozen=True)
class Picture:
    """Snapshot of a session at one time."""

    load: int
    """Number of scenes loaded until now: another number, another model"""
    revision: int
    """Number that changes whenever values of the scene changed otherwise than by being set"""
    granted: int
    """Number of wishes that it shows; later ones it does not"""
    name: str
    model: Model
    scene: Scene
    frame: Frame
    seconds: float
    sphere_numbers: tuple[int, ...]
    """Numbers of the spheres that exist, over the whole simulation"""
    hands: frozenset[int]
    """Strings that are a user's hands"""
    inflation: float
    running: bool
    speed: float
    rate: float
    """Simulated seconds over the wall's"""
    step_seconds: float
    """Wall-clock time for a frame [s]"""
    schedule: str
    trouble: str
    """Blow-up or failure, in a sentence; empty without one"""
    why: str
    """Further explanation, where more is known"""
    recorded_seconds: float | None
    """Length of the recording in progress [s]"""
