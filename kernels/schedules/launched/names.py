"""Names that phases read, as launches find them: the state is in arrays."""

from collections.abc import Mapping
from typing import ClassVar

from balloon_warp.kernels.phase import VIEWS
from balloon_warp.kernels.schedules.pieces import Step
from balloon_warp.kernels.schedules.writer import Writer

HANDLES = ("t", "time_in_frame", "state", "working")
NAMES: Mapping[str, tuple[str, str]] = {
    "time": ("", "time_of(t, state.frame, time_in_frame)"),
    "end": ("", "time_in_frame + t.step_seconds"),
    "points": ("", "all_points[world]"),
    "velocities": ("", "all_velocities[world]"),
    "spheres": ("", "spheres_in_state(t, state, working)"),
    "numbers": ("", "read_numbers(t, world, balloon)"),
}
"""Expressions for the names that phases read: names that the expression needs, and its text"""
OF_PARTICLE: Mapping[str, tuple[str, str]] = {
    "params": ("", "read_params(t, world, particle)"),
    "balloon": ("params", "params.balloon"),
    "point": ("", "vector_in(all_points, world, particle)"),
    "velocity": ("", "vector_in(all_velocities, world, particle)"),
    "origin": ("balloon", "all_points[world, volume_origin(t, balloon)]"),
    "gas_mass": ("balloon", "working.gas_masses[world, balloon]"),
    "keyed": ("balloon", "ramp_at(state, world, balloon, time_in_frame)"),
    "load": ("balloon", "two_in(state.inflation_loads, world, balloon)"),
}
"""Expressions for names of a particle"""


class PieceWriter(Writer):
    """Find what phases name where the state is in arrays."""

    aliases: ClassVar[Mapping[str, str]] = {"springs": "working"}

    def __init__(self, step: Step):
        super().__init__(step, (*HANDLES, "world"))

    def _begin(self, indices: str) -> None:
        self.line(f"{indices} = wp.tid()")
        if self.step.features.frames == "busy":
            self.line("if working.verdicts[world] == 0:")
            self.line("    return")
        self.known |= set(indices.split(", "))

    def found(self, name: str) -> tuple[str, str] | None:
        """Return the arguments that a name depends on, and the text that computes it."""
        kept = self.step.kept
        if VIEWS.get(name) in kept:
            return "", f"all_{VIEWS[name]}[world]"
        if name in kept:
            item = self.step.owner(name)
            return (item if item == "balloon" else ""), f"all_{name}[world, {item}]"
        if text := self.kept_at(name):
            return "", text
        particles = "particle" in self.known
        if particles and name in OF_PARTICLE:
            return OF_PARTICLE[name]
        if name in NAMES:
            return NAMES[name]
        return self.number_at(name) if particles or "sphere" in self.known else None
