"""A list of phases cut into pieces: the phases between two barriers."""

from collections.abc import Collection, Sequence
from typing import Any, NamedTuple

from balloon_warp.kernels.features import Features
from balloon_warp.kernels.named_state import NAMED
from balloon_warp.kernels.phase import STATE, VIEWS, Item, Look, Phase


class Piece(NamedTuple):
    """Hold phases that one thread executes, one after the other."""

    phases: tuple[Phase, ...]
    once: bool
    """Whether the pieces are for the first substep of a frame only"""
    takes: tuple[str, ...]
    """Values that the piece reads and earlier pieces have written"""
    leaves: tuple[str, ...]
    """Values that the piece writes and later ones read"""
    moves: tuple[str, ...]
    """State of a particle that the piece writes"""
    keeps: tuple[str, ...]
    """Values that the piece writes and items keep"""
    doubles: tuple[str, ...]
    """State that others read meanwhile: it is double-buffered, one buffer to read and one to write"""

    @property
    def name(self) -> str:
        """Return the name of its kernel."""
        first, last = self.phases[0].name, self.phases[-1].name
        whose = "balloon" if self.sums else "world" if self.item == "team" else self.item
        return f"{whose}s_{first}" if first == last else f"{whose}s_{first}_to_{last}"

    @property
    def item(self) -> Item:
        """Return the kind of item that the piece belongs to."""
        return self.phases[0].item

    @property
    def last(self) -> bool:
        """Return whether the piece is executed only at a frame's end."""
        return self.phases[0].last

    @property
    def sums(self) -> bool:
        """Return whether a block sums the results of its items over their balloon."""
        return self.phases[0].sums


class Step(NamedTuple):
    """Hold the phases that a scene has, in pieces, for a schedule that launches them."""

    features: Features
    look: Look
    pieces: tuple[Piece, ...]
    light: tuple[Phase, ...]
    """Phases that are recomputed wherever their values are read"""
    apart: frozenset[str] = frozenset()
    """Names of phases that begin a piece anyway"""

    def owner(self, value: str) -> Item:
        """Return the kind of items that have a value."""
        phase = self.writer(value)
        return "balloon" if phase.sums else phase.item

    def writer(self, value: str) -> Phase:
        """Return the first phase that writes a value."""
        return next(phase for piece in self.pieces for phase in piece.phases if value in phase.writes)

    @property
    def kept(self) -> tuple[str, ...]:
        """Return the values that live from one piece to another."""
        return tuple(dict.fromkeys(value for piece in self.pieces for value in piece.leaves))

    @property
    def doubled(self) -> tuple[str, ...]:
        """Return the state of particles that has two places."""
        return tuple(dict.fromkeys(name for piece in self.pieces for name in piece.doubles))


def cut(
    phases: Sequence[Phase],
    features: Features,
    look: Look,
    *,
    doubles: bool = True,
    apart: Collection[str] = (),
    sums_along: bool = False,
    shown: Collection[str] = (),
) -> Step:
    """Cut the phases that a scene has into pieces.

    Args:
        doubles: whether state may have a second place, where otherwise a barrier would be needed.
        apart: names of phases that begin a piece anyway.
        sums_along: whether those who add up may do so as they go, at the end of a piece; otherwise a sum begins one,
            and who adds up goes on with the balloon.
        shown: values that somebody reads afterwards.

    Raises:
        TypeError: a phase changes state that has no name, see `Phase.changes`, or is named like what another reads.
    """
    named = {name for phase in phases for name in phase.reads(features, look)}
    for phase in phases:
        phase.changes(features, look)
        if phase.name in named:
            raise TypeError(f"the phase {phase.name} is named like what another reads; expected a name of its own")
    light = tuple(phase for phase in phases if phase.light)
    groups: list[list[Phase]] = []
    for phase in phases:
        if phase.light:
            continue
        if not groups or phase.name in apart or not _goes_on(groups[-1], phase, features, look, doubles, sums_along):
            groups.append([])
        groups[-1].append(phase)
    read = [_read(group, light, features, look) for group in groups]
    pieces = [
        _piece(group, read[place], set(shown).union(*read[place + 1 :], *read[:place]), features, look)
        for place, group in enumerate(groups)
    ]
    return Step(features, look, tuple(pieces), light, frozenset(apart))


def _goes_on(
    group: Sequence[Phase], phase: Phase, features: Features, look: Look, doubles: bool, sums_along: bool
) -> bool:
    """Return whether the thread that executes a group may go on with a phase."""
    first = group[0]
    if phase.once(features) != first.once(features) or phase.last != first.last:
        return False
    if any(each.sums for each in group):
        return not sums_along and phase.item == "balloon"
    if phase.sums and not sums_along:
        return False
    if first.item in ("particle", "face"):
        written = {name for each in group for name in each.writes}
        looked_at = {name for each in group for name in each.views(features, look)}
        places = features.kept if doubles else STATE | features.kept
        waits = phase.views(features, look) & written or places.keys() & phase.writes.keys() & looked_at
        waits = waits or _of_others(group, features, look) & phase.looks_at(features, look)
        return phase.item == first.item and (phase.item == "particle" or phase.sums) and not waits
    small = ("world", "balloon")
    return first.item in small and phase.item in small


def _of_others(group: Sequence[Phase], features: Features, look: Look) -> set[str]:
    """Return the names of the state of other items that a group changes, see `named_state`."""
    changed = {name for phase in group for name in phase.changes(features, look)}
    return {name for name in changed if NAMED[name].item != group[0].item}


def _read(group: Sequence[Phase], light: Sequence[Phase], features: Features, look: Look) -> set[str]:
    """Return the inputs of a group that it has not written itself, with those of light phases that write them."""
    found: set[str] = set()
    written: set[str] = set()
    for phase in group:
        found |= _with_light(phase.reads(features, look), light, features, look) - written
        written |= phase.writes.keys()
    return found


def _with_light(names: Collection[str], light: Sequence[Phase], features: Features, look: Look) -> set[str]:
    """Return names, with the inputs of light phases that write them; of a view, the value that is seen."""
    found: set[str] = set()
    to_see = list(names)
    views = VIEWS | features.kept_views
    while to_see:
        name = to_see.pop()
        found.add(views.get(name, name))
        for phase in light:
            if name in phase.writes:
                to_see += phase.reads(features, look)
    return found


def _piece(group: Sequence[Phase], read: set[str], read_elsewhere: set[str], features: Features, look: Look) -> Piece:
    written = tuple(dict.fromkeys(name for phase in group for name in phase.writes))
    values = tuple(name for name in written if name not in STATE and name not in features.kept)
    looked_at: set[str] = set().union(*(phase.views(features, look) for phase in group))
    moves = tuple(name for name in written if name in STATE)
    return Piece(
        tuple(group),
        group[0].once(features),
        takes=tuple(sorted(read)),
        leaves=tuple(name for name in values if name in read_elsewhere),
        moves=moves,
        keeps=tuple(name for name in written if name in features.kept),
        doubles=tuple(name for name in moves if name in looked_at),
    )


def values_of(step: Step) -> dict[str, Any]:
    """Return the types of the values that are kept."""
    return {value: step.writer(value).writes[value] for value in step.kept}
