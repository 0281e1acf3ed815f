"""Forces on the particles of busy worlds, eight particles side by side: a launch of its own in each substep.

The other phases of such worlds are launched one by one, and read the results of this one.
"""

from functools import cache
from typing import Any

from balloon_warp.kernels.codegen import kernel_from
from balloon_warp.kernels.options import OPTIONS
from balloon_warp.kernels.schedules.lanes.layouts import OCTETS
from balloon_warp.kernels.schedules.lanes.source import FrameWriter
from balloon_warp.kernels.schedules.lanes.state import reading_functions, writing_function
from balloon_warp.kernels.schedules.pieces import Step
from balloon_warp.kernels.schedules.writer import named_in


class _Writer(FrameWriter):
    """Write the source of some phases of a substep, which leave values of particles."""

    def __init__(self, step: Step):
        super().__init__(step, OCTETS)

    @property
    def name(self) -> str:
        """Return the name of the kernel."""
        return "pull_octets"

    @property
    def remark(self) -> str:
        """Return a sentence on a thread's work."""
        return "A thread for each world: some phases of a substep."

    def arguments(self) -> dict[str, str]:
        """Return the names of the kernel's arguments, as it needs them, and their types."""
        more = {
            "clock": "Clock",
            "substep": "wp.int32",
            "from_points": "wp.array2d[wp.vec3]",
            "from_velocities": "wp.array2d[wp.vec3]",
            **{f"to_{value}": f"wp.array2d[{value}_type]" for value in self.step.pieces[-1].leaves},
        }
        return super().arguments() | named_in(self.lines, more)

    def _frame(self) -> None:
        self.line("group = wp.tid()")
        if self.step.features.frames == "busy":
            self.line("if working.verdicts[group] == 0:")
            self.line("    return")
        self.line("time_in_frame = time_in_frame_of(clock, substep)")
        self.line("if time_in_frame == 0.0:")
        self.line("    read_numbers(t, group)")
        self.line("points = all_points[group]")
        self.line("velocities = all_velocities[group]")
        self.line("read_particles(t, group, from_points, from_velocities, points, velocities)")
        self.line("time = time_of(tables, state.frame, time_in_frame)")
        for piece in self.step.pieces:
            self._piece(piece)
        for value in self.step.pieces[-1].leaves:
            self.line(f"write_vectors(t, group, all_{value}[group], to_{value})")

    def names(self) -> dict[str, Any]:
        """Return the objects that the text refers to, by name."""
        read_numbers, read_particles = reading_functions(self.step.features, self.layout)
        write_vectors = writing_function(self.layout)
        return super().names() | {
            "read_numbers": read_numbers, "read_particles": read_particles, "write_vectors": write_vectors,
        }  # fmt: skip


@cache
def pulling_kernel(step: Step) -> Any:
    """Make the kernel; a thread a world."""
    writer = _Writer(step)
    return kernel_from(writer.name, writer.source(), writer.names(), module_options=OPTIONS)


def pulling_source(step: Step) -> str:
    """Write the kernel."""
    return _Writer(step).source()


@cache
def pulling_arguments(step: Step) -> dict[str, str]:
    """Return the names of its arguments, in order, and their types."""
    writer = _Writer(step)
    writer.source()
    return writer.arguments()
