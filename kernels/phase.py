"""A phase: what one item of a world does in a substep, between two barriers.

Its function is one of Warp, of plain arguments. Their names say what it reads, `writes` says what it returns. So a
schedule, which knows no physics, can execute any list of phases: it finds what each reads, keeps what a later one
reads, and puts a barrier where one looks at what others have written. The step is such a list, see `substep`.

A name that a phase reads is one of these:

- a handle: `t`, the tables; `state`; `working`, what contact keeps beside the state; `time_in_frame` [s]
- the item: `world`, and within it `balloon`, `particle`, `face`, `triangle` or `sphere`, or all `threads` of a block
- `own`, what a particle knows of itself, see `own`; a row of numbers of a law, by its name
- state of a particle, `point` [m] and `velocity` [m/s], or a view of all in its world, `points` and `velocities`
- a value that an earlier phase of the list has written
- the time: `time` when the substep begins, and `end` when it ends [s]
- what a schedule says itself of items, see there: `keyed`, `load`, `gas_mass`, `origin`

Where all that it reads is of type `Any`, it is a function of one item or of eight side by side, see `algebra`.
"""

import inspect
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cache
from typing import Any, Literal, NamedTuple

from balloon_warp.kernels.memory import add_at, put_vector, vector_at
from balloon_warp.kernels.traits import Traits
from balloon_warp.kernels.warp_sums import sum_over_block

Item = Literal[
    "world", "balloon", "particle", "face", "triangle", "quad", "hinge", "spring", "element", "film", "sphere", "team",
    "launches",
]  # fmt: skip
"""whose phase it is: `quad` is that of a quad or triangle of a membrane, `film` of a face of one; `element` that of a
spring, string, hinge, triangle or face; `team` that of all threads of a
block, for a world; `launches` one of the host's own"""
VIEWS = {"points": "point", "velocities": "velocity", "face_centers": "face_center", "face_areas": "face_area"}
"""what is seen of all items, and what each of them has of it"""
TIMES = ("time", "end", "time_in_frame")
"""what is the same for all items"""
STATE = {"point": "points", "velocity": "velocities"}
"""what a particle keeps from one substep to the next, and the arrays that it stands in"""


class Look(NamedTuple):
    """Hold the functions by which the items of a schedule see each other."""

    at: Any
    """the function that reads a point from a view"""
    sphere_at: Any
    """the function that gives a sphere's center, velocity and radius"""
    loops: Callable[[Traits], Any]
    """what a particle goes through for its forces, see `loops.net_force`"""
    alone: Callable[[Traits], bool] = lambda traits: False
    """whether these need no other particle"""
    put: Any = put_vector
    """the function that writes a point into a view"""
    velocity_at: Any = vector_at
    put_velocity: Any = put_vector
    in_team: tuple[Any, Any, Any] = (vector_at, put_vector, sum_over_block)
    """the functions that read and write a point or velocity, and that add up what threads have, where all of a block
    have a phase"""
    add: Any = add_at
    """the function that adds a force to those in a view"""
    world: Any = None
    """the function that gives the world in one of eight lanes, where eight stand side by side"""
    films: Callable[[Traits], Any] = lambda traits: None
    """what faces of membranes do, where each is measured once, see `phases.stretch`"""


@dataclass(frozen=True, eq=False)
class Phase:
    """Describe one line of a list of phases."""

    name: str
    item: Item
    make: Callable[[Traits, Look], Any]
    """the function, for what a scene has"""
    writes: Mapping[str, Any] = field(default_factory=dict)
    """names of what it returns, in order, and their types; a sum's is one of the balloon"""
    when: Callable[[Traits], bool] = lambda traits: True
    """whether a scene has it"""
    sums: bool = False
    """whether what it returns is added up over the items of each balloon before anyone may read it"""
    light: bool = False
    """whether it is found again wherever it is read, of what stays the same in a substep, rather than kept; in all of a
    frame if it happens but once"""
    once: Callable[[Traits], bool] = lambda traits: False
    """whether it happens only as a frame begins"""
    rare: Callable[[Traits, Look], Any] | None = None
    """the function that says whether it does anything at all for an item, or for any of eight: otherwise what it writes
    stays as it was, or is zero. A schedule may ask it first"""
    last: bool = False
    """whether it happens only as a frame ends"""
    due: Callable[[Traits], Any] | None = None
    """the function that says whether there is anything to do, by names of handles alone: in one thread of a block"""
    also_reads: tuple[str, ...] = ()
    """of a phase of the host: values"""

    @property
    def summary(self) -> str:
        """Say what it does, in a line."""
        return " ".join((self.make.__doc__ or self.name).partition("\n\n")[0].split())

    def function(self, traits: Traits, look: Look) -> Any:
        """Return its `wp.func` for what a scene has."""
        return _made(self, traits, look)

    def reads(self, traits: Traits, look: Look) -> tuple[str, ...]:
        """Return the names that it reads: those of its arguments."""
        if self.item == "launches":
            return self.also_reads
        return tuple(inspect.signature(self.function(traits, look).func).parameters)

    def takes_eight(self, traits: Traits, look: Look) -> bool:
        """Return whether it is the same for one item and for eight side by side: of nothing it says what it is."""
        told = inspect.signature(self.function(traits, look).func).parameters
        return all(each.annotation is Any or name in TIMES for name, each in told.items())

    def asked(self, traits: Traits, look: Look) -> Any:
        """Return the function that says whether it does anything, or None where it always may."""
        return _asked(self, traits, look) if self.rare else None

    def views(self, traits: Traits, look: Look) -> set[str]:
        """Return what it looks at in other items: what they must not write meanwhile."""
        return {VIEWS[name] for name in self.reads(traits, look) if name in VIEWS}


@cache
def _made(phase: Phase, traits: Traits, look: Look) -> Any:
    return phase.make(traits, look)


@cache
def _asked(phase: Phase, traits: Traits, look: Look) -> Any:
    return phase.rare(traits, look) if phase.rare else None


def phase(item: Item, writes: Mapping[str, Any] | None = None, **said: Any) -> Callable[[Any], Phase]:
    """Decorate what makes a phase's function: it becomes the phase, named alike."""

    def named(make: Any) -> Phase:
        return Phase(make.__name__, item, make, writes or {}, **said)

    return named
