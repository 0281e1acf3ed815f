"""What is to be seen of a session, which whoever draws it takes as a whole."""

from dataclasses import dataclass

from balloon_warp.frame import Frame
from balloon_warp.model import Model
from balloon_warp.scene import Scene


@dataclass(frozen=True)
class Picture:
    """What is to be seen of a session at one time."""

    load: int
    """how many scenes were loaded until now: another number, another model"""
    revision: int
    """changes whenever values of the scene changed otherwise than by being set"""
    granted: int
    """how many wishes it shows; what was asked since, it does not"""
    name: str
    model: Model
    scene: Scene
    frame: Frame
    seconds: float
    sphere_numbers: tuple[int, ...]
    """of the spheres that are there, over the whole simulation"""
    hands: frozenset[int]
    """strings that are hands"""
    inflation: float
    running: bool
    speed: float
    rate: float
    """simulated seconds over the wall's"""
    step_seconds: float
    """of the wall's clock, for a frame"""
    schedule: str
    trouble: str
    """what happened, if it blew up or failed, in a sentence; else nothing"""
    why: str
    """more of that, where more is known"""
    recorded_seconds: float | None
    """of the recording that goes on"""
