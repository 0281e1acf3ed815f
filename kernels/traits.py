"""What a scene uses of the physics: kernels are made for it, so that what it does not use costs nothing."""

from typing import NamedTuple


class Traits(NamedTuple):
    """Of a model, for all its worlds."""

    springs_vary: bool = False
    """springs of one kind differ"""
    rubber: bool = False
    """springs are viscous, or pull no more once they are overextended"""
    torsion: bool = False
    """angles between faces are kept"""
    corrected: bool = False
    """springs that are too long after a step are shortened"""
    in_water: bool = False
    in_air: bool = False
    """there is pressure, gas or drag in air"""
    forward_euler: bool = False
    """points move by the old velocities"""

    impulses: bool = False
    """touching particles and spheres exchange momentum"""

    @property
    def keeps_velocities(self) -> bool:
        """Whether velocities before a substep are needed when some after it are known."""
        return self.rubber or self.in_air
