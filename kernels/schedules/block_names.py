"""Places of the values that phases name in a block: registers, shared memory, or arrays."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from typing import Any, NamedTuple

import warp as wp

from balloon_warp.kernels.features import Features
from balloon_warp.kernels.loops.membranes import MembraneFaceLayout
from balloon_warp.kernels.loops.net_force import Loops, scalar_loops
from balloon_warp.kernels.loops.quads import kept_springs, membrane_face_functions
from balloon_warp.kernels.loops.spheres import shared_spheres
from balloon_warp.kernels.loops.springs import ring_area, ring_normal, slot_loop, springs_reader
from balloon_warp.kernels.memory import in_tile, put_in_tile
from balloon_warp.kernels.phase import STATE, VIEWS, Access, Phase
from balloon_warp.kernels.schedules.writer import Step, Writer


class Layout(NamedTuple):
    """Layout of a kernel, beside the scene's features."""

    threads: int
    """Number of threads in a block"""
    capacity: int
    """Number of points that a tile holds"""
    held: int = 0
    """Number of particles that a thread keeps in registers for a frame; 0 where threads loop over all particles"""
    slots: tuple[int, int, int] = (0, 0, 0)
    """Largest number of springs of each kind at a particle, which also stay in registers"""
    rings: int = 0
    """Least number of quads around a particle, if area vectors follow from the ring of springs around it; else 0"""
    tiles: tuple[str, ...] = ()
    """State of particles in shared memory, where threads loop"""
    ordered: bool = False
    """Whether particles stand by their number of springs, so that no thread of a warp waits for another"""
    doubled: bool = True
    """Whether points may have a second tile in place of a barrier"""
    membrane_face: MembraneFaceLayout | None = None
    """Layout of the faces of membranes, if each face is measured once"""
    odd: bool = False
    """Whether a launch has an odd number of substeps"""
    registers: int = 64
    """Registers of a thread"""

    @property
    def warps(self) -> int:
        """Return how many warps a block has; on a CPU a block is one thread."""
        return max(self.threads // 32, 1)


@cache
def looping_loops(features: Features) -> Loops:
    """Return loops over the entries of tables."""
    return scalar_loops(features, in_tile, inflation_directions=features.directions_on_the_way)


@cache
def held_loops(slots: tuple[int, int, int], rings: int) -> Callable[[Features], Loops]:
    """Return loops over springs that are held in registers."""

    @cache
    def loops_of(features: Features) -> Loops:
        area_vector = ring_area(slots[0], rings) if rings else None
        vertex_normal = ring_normal(slots[0]) if features.directions_on_the_way else None
        return scalar_loops(features, in_tile, slot_loop(features, slots), area_vector, vertex_normal)

    return loops_of


@cache
def access_of(layout: Layout, spheres: int) -> Access:
    """Return how items see each other on a layout, with so many spheres."""
    access = Access(in_tile, shared_spheres(spheres)[2] if spheres else None, looping_loops, put=put_in_tile)
    if layout.membrane_face:
        membrane_face, slots = layout.membrane_face, layout.slots if layout.held else None
        access = access._replace(
            loops=lambda features: membrane_face_functions(features, membrane_face, slots).loops,
            membrane_faces=lambda features: membrane_face_functions(features, membrane_face, slots),
        )
    elif layout.held or any(layout.slots):
        access = access._replace(loops=held_loops(layout.slots, layout.rings), slots=layout.slots, ring=layout.rings)
    return access._replace(velocity_at=in_tile, put_velocity=put_in_tile) if "velocity" in layout.tiles else access


def reader_of_springs(features: Features, layout: Layout, derived: bool = False) -> Any:
    """Return the function that reads a particle's kept springs, and places of its faces.

    Args:
        derived: whether it is read for derivatives, too.
    """
    if layout.membrane_face:
        return kept_springs(features, layout.membrane_face, layout.slots)[1]
    return springs_reader(features, layout.slots, derived)[1]


HANDLES = ("t", "slots", "state", "working", "world", "thread", "spheres", "membrane_faces", "pulls", "area_vectors")
OF_SUBSTEP = ("time_in_frame", "time", "end")
OF_BALLOON = ("balloon", "ramp", "keyed", "load", "gas_mass", "origin", "origin_place", "numbers")
"""Values that the particles of a balloon have in common"""


class NamesInBlock(Writer):
    """Find names for a block, which may be about one of the particles that a thread keeps."""

    def __init__(self, step: Step, layout: Layout, alone: bool):
        super().__init__(step, (*HANDLES, "points", "new_points", "velocities", "new_velocities"))
        self.layout, self.features = layout, step.features
        self.alone = alone
        """Whether the block has particles of one balloon only, so that its sums and values hold for all threads"""
        self.aliases = {"springs": "skin"} if layout.membrane_face else {}
        self.place: int | None = None
        """Index of the thread's particle at hand"""
        self.turn, self.next_turn = "0", "1"
        """Expressions for the parity of the substep, and of the next"""
        self.points = ("points", "new_points")
        """Tiles from which points are read, and to which they are written while others still read"""
        self.velocities = ("velocities", "new_velocities")
        self._common = {*OF_SUBSTEP, *HANDLES}
        if self.alone:
            written = (phase for phase in self.phases if phase.item != "particle" or phase.sums)
            self._common |= {*OF_BALLOON, *(value for phase in written for value in phase.writes)}

    @property
    def phases(self) -> tuple[Phase, ...]:
        """Return all phases."""
        return (*(phase for piece in self.step.pieces for phase in piece.phases), *self.step.light)

    @property
    def places(self) -> range:
        """Return the particles that a thread keeps."""
        return range(self.layout.held)

    @property
    def keeps_load(self) -> bool:
        """Return whether all threads find the pressure of the one balloon, so that none need read it."""
        return self.features.gas and self.alone and not self.features.gas_flows

    def bound(self, name: str) -> str:
        """Return the variable of a phase's argument or result; each particle that a thread keeps has its own."""
        if name == "points":
            return self.points[0]
        if name == "velocities":
            return self.velocities[0]
        numbered = self.place is not None and self.are_numbered and name not in self._common
        return f"{name}_{self.place}" if numbered else name

    @property
    def are_numbered(self) -> bool:
        """Return whether held particles have numbered variables: a thread has several, or other items have the names.

        Such items are the faces and balloons of a loop, where there are several balloons.
        """
        return self.layout.held > 1 or (self.layout.held == 1 and not self.alone)

    def params_of_any(self) -> str:
        """Return the variable of the parameters of some particle of a thread."""
        return ("params_0" if self.are_numbered else "params") if self.layout.held else "first"

    def forget(self, name: str) -> None:
        """Drop a name: it is computed again wherever it is read from here on."""
        self.known -= {name, *(f"{name}_{place}" for place in self.places)}

    def found(self, name: str) -> tuple[str, str] | None:
        """Return the arguments that a name depends on, and the text that computes it."""
        anywhere = {
            "time": ("", "frame_begin + time_in_frame"),
            "end": ("", "time_in_frame + t.step_seconds"),
            "springs": (
                ("params", self.springs_in_slots)
                if any(self.layout.slots)
                else ("", "working")  # they are read from tables
            ),
        }
        if name in anywhere:
            return anywhere[name]
        if VIEWS.get(name) in self.step.kept:
            return "", f"all_{VIEWS[name]}[world]"
        if kept := self.found_kept(name):
            return kept
        is_particle = self.place is not None or "particle" in self.known
        return self._of_particle(name) if is_particle else self._of_balloon(name)

    def _of_balloon(self, name: str) -> tuple[str, str] | None:
        if name == "numbers":
            return "", f"{self.params_of_any()}.n" if self.alone else "read_numbers(t, world, balloon)"
        if name == "balloon" and self.alone:
            return "", f"{self.params_of_any()}.balloon"
        if name in self.step.kept and self.step.owner(name) == "balloon":
            return "", f"all_{name}[world, balloon]"
        return self.number_at(name) if "sphere" in self.known else None

    def _of_particle(self, name: str) -> tuple[str, str] | None:
        params, balloon, ramp = self.bound("params"), self.bound("balloon"), self.bound("ramp")
        reads = "read_params_beside(t, first, particle)" if self.alone else "read_params(t, world, particle)"
        texts = {
            "params": ("", reads),
            "balloon": ("", f"{self.params_of_any()}.balloon") if self.alone else ("params", f"{params}.balloon"),
            "numbers": ("params", f"{params}.n"),
            "number": ("", self.number),
            "point": ("", f"in_tile({self.points[0]}, particle)"),
            "velocity": ("", self.read("velocity")),
            "ramp": ("balloon", f"state.inflation_ramp[world, {balloon}]"),
            "keyed": ("ramp", f"{ramp}[0] + {ramp}[1] * time_in_frame"),
            "origin_place": ("balloon", f"volume_origin(t, {balloon})"),
            "origin": ("origin_place", f"in_tile({self.points[0]}, {self.bound('origin_place')})"),
            "gas_mass": ("balloon", f"working.gas_masses[world, {balloon}]"),
            "load": ("balloon", f"two_in(state.inflation_loads, world, {balloon})"),
        }  # fmt: skip
        if name == "load" and self.keeps_load:
            return "", "wp.vec2(gas_load[1], gas_load[2])"
        if name in texts:
            return texts[name]
        if name in self.step.kept:
            of_particle = self.step.owner(name) == "particle"
            return ("", self.read(name)) if of_particle else ("balloon", f"all_{name}[world, {balloon}]")
        number = self.number_at(name, params)
        return ("params", number[1]) if number else None

    @property
    def springs_in_slots(self) -> str:
        """Return the text that reads the springs of the particle at hand of a loop."""
        if self.features.springs_vary:
            return "read_springs(t, slots, params, particle, True)"
        return "read_pairs(slot_pairs, slots, params)"

    @property
    def number(self) -> str:
        """Return the number in the state of the particle at hand."""
        return "state_numbers[particle]" if self.layout.ordered else self.bound("particle")

    def home(self, name: str) -> str:
        """Return where a value of particles waits."""
        return self.velocities[0] if name == "velocity" else f"each_{name}"

    def read(self, name: str) -> str:
        """Return how a value of a particle is read from where it waits."""
        if not self._is_vector(name):
            return f"{self.home(name)}[particle]"
        return f"{'in_tile' if name in self.layout.tiles else 'vector_at'}({self.home(name)}, particle)"

    def _is_vector(self, name: str) -> bool:
        return name in STATE or self.step.writer(name).writes[name] is wp.vec3

    def write(self, name: str, target: str) -> str:
        """Return the statement that stores a value of a particle."""
        if not self._is_vector(name):
            return f"{target}[particle] = {name}"
        return f"{'put_in_tile' if name in self.layout.tiles else 'put_vector'}({target}, particle, {name})"

    @contextmanager
    def about(self, place: int) -> Iterator[None]:
        """Switch to one of the particles that a thread keeps."""
        self.place = place
        yield
        self.place = None

    @contextmanager
    def indented(self) -> Iterator[None]:
        """Write the block below the line before; names bound there are not bound after."""
        known, self.indent = set(self.known), self.indent + "    "
        yield
        self.known, self.indent = known, self.indent[:-4]
