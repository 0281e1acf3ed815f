"""Phases as one kernel: a thread advances eight worlds, or one, by a frame. Its source is written from the list, flat.

Where a phase takes eight side by side, an item goes through it at once. Any other is called lane by lane, for one that
is rare once it is known that something in the lanes needs it at all.
"""

from collections.abc import Callable, Mapping
from functools import cache
from itertools import groupby
from typing import Any

from balloon_warp.kernels.algebra import scaled
from balloon_warp.kernels.codegen import kernel_from
from balloon_warp.kernels.lanes import IN_LANES, LANE_COUNT, Lanes3, of_lane, set_lane
from balloon_warp.kernels.loops.near_solids import Solids
from balloon_warp.kernels.options import OPTIONS
from balloon_warp.kernels.phase import STATE, Item
from balloon_warp.kernels.schedules.lanes.items import ItemsInLanes
from balloon_warp.kernels.schedules.lanes.layouts import Layout, of_item, of_particle, put_item, view_of
from balloon_warp.kernels.schedules.lanes.places import places_of
from balloon_warp.kernels.schedules.lanes.state import (
    balloon_functions,
    frame_functions,
    kept_functions,
    params_functions_of,
    showing_function,
)
from balloon_warp.kernels.schedules.lanes.tables import lane_structs
from balloon_warp.kernels.schedules.pieces import Piece, Step, values_of
from balloon_warp.kernels.schedules.writer import head, named_in, written_types

COUNTS: Mapping[Item, str] = {
    "sphere": "state.sphere_positions.shape[1]", "triangle": "tables.membranes.corners.shape[0]",
    "hinge": "tables.hinges.ends.shape[0]", "spring": "tables.correction.particles.shape[0]",
    "face": "tables.faces.balloon.shape[0]",
}  # fmt: skip
"""Number of the items of a world that are looped over one by one"""
MOVERS: set[Item] = {"sphere", "world", "balloon", "team"}
"""Items whose phases may move spheres"""


class FrameWriter(ItemsInLanes):
    """Write the source of a frame."""

    @property
    def name(self) -> str:
        """Return the name of the kernel."""
        return "advance_worlds" if self.layout.worlds else "advance_octets"

    # ---- the frame

    def source(self) -> str:
        """Return the text of the kernel."""
        if not self.lines:
            self._frame()
        return "\n".join([*head(self.name, self.arguments(), self.remark), *self.lines, ""])

    @property
    def remark(self) -> str:
        """Return a sentence on a thread's work."""
        return f"A thread for each {'eight worlds' if self.layout.worlds else 'world'}: a frame."

    def arguments(self) -> dict[str, str]:
        """Return the names of the kernel's arguments, as it needs them, and their types."""
        states = {view: "Seen" if view in self.seen else "Lanes3" for view in STATE.values()}
        may_be = {
            "t": "LaneTables", "tables": "Tables", "first_group": "wp.int32", "state": "WorldState",
            "working": "Working", "solids": "Solids", **self.kept_arrays,
            **{f"all_{view}": f"wp.array2d[{kind}]" for view, kind in states.items()},
            **{f"other_{view}": f"wp.array2d[{kind}]" for view, kind in states.items()},
            **{
                f"all_{value}": f"wp.array2d[{'Seen' if value in self.seen else f'{value}_lanes'}]"
                for value in self.step.kept
            },
            **{f"all_{value}_parts": f"wp.array2d[{value}_lanes]" for value in self.step.kept},
        }  # fmt: skip
        return named_in(self.lines, may_be)

    def _frame(self) -> None:
        self.line("group = first_group + wp.tid()")
        if self.step.features.watched:
            self.line("if not any_free(t, working, group):")
            self.line("    return")
        if self.step.features.spheres:
            self.line("spheres = spheres_in_state(tables, state, working)")
        for view in STATE.values():
            self.line(f"{view} = all_{view}[group]")
        for view in self.doubled:
            self.line(f"new_{view} = other_{view}[group]")
        self.line("read_frame(t, state, working, group, points, velocities)")
        self.substeps()
        self.line(f"write_frame(t, state, working, group, {self.bound('points')}, {self.bound('velocities')})")

    def substeps(self) -> None:
        """Write the loop over substeps."""
        self.line("for substep in range(tables.substeps):")
        with self.deeper():
            self._begin_substep()
            for once, pieces in groupby(self.step.pieces, key=lambda piece: piece.once):
                if once:
                    self.line("if substep == 0:")
                with self.deeper(int(once)):
                    for piece in pieces:
                        self._piece(piece)

    def _begin_substep(self) -> None:
        self.line("time_in_frame = float(substep) * t.step_seconds")
        self.line("time = time_of(tables, state.frame, time_in_frame)")
        self.line("end = time_in_frame + t.step_seconds")
        turns = [view for view in self.doubled if sum(self._flips(piece, view) for piece in self.step.pieces) % 2]
        for condition, names in (("if substep % 2 == 1:", ("other", "all")), ("else:", ("all", "other"))):
            if turns:
                self.line(condition)
            for view in turns:
                self.line(f"    {view} = {names[0]}_{view}[group]")
                self.line(f"    new_{view} = {names[1]}_{view}[group]")

    # ---- a piece

    def _piece(self, piece: Piece) -> None:
        known, single = set(self.known), dict(self.single)
        wide = piece.phases[0].takes_eight(self.step.features, self.step.look)
        self._show_solids(piece)
        if piece.phases[-1].sums:
            self._sum(piece)
        elif piece.item in ("particle", "quad") or (piece.item == "face" and wide):
            self._items(piece.item, lambda: (self.calls(piece.phases), self._leave(piece)))
        elif piece.item in COUNTS:
            self._singles(piece)
        else:
            self._each_world(lambda: self._worlds(piece))
        self.known, self.single = known, single
        for view in self.flips:
            self.flips[view] += self._flips(piece, view)
        self.shown = self.shown and piece.item not in MOVERS

    def _show_solids(self, piece: Piece) -> None:
        """Show spheres and obstacles, if the piece asks about them and they may have moved."""
        phases = (*piece.phases, *self.step.light)
        asks = any("solids" in self.names_of(phase.asked(self.step.features, self.step.look)) for phase in phases)
        if asks and piece.item == "particle" and not self.shown:
            self.line("show_solids(t, tables, state, solids, group, end)")
            self.shown = True

    def _singles(self, piece: Piece) -> None:
        """Write a loop over items that are gone through one by one, in each world."""
        kind = piece.item
        if kind == "spring":
            self.line("for _sweep in range(tables.correction.sweeps):")
        with self.deeper(int(kind == "spring")):
            self.line(f"for {kind} in range({COUNTS[kind]}):")
            self.known.add(kind)
            self.single[kind] = kind
            with self.deeper():
                self._each_world(lambda: (self.calls(piece.phases), self.keep_of_one(piece.keeps)))

    def _each_world(self, body: Callable[[], Any]) -> None:
        """Write a loop over a group's worlds."""
        self.line("for place in range(worlds_of(group, t.world_count)):")
        self.lane, single = "place", dict(self.single)
        with self.deeper():
            self.line("world = first_world(group) + place")
            self.single |= {"world": "world", "balloon": "balloon"}
            body()
        self.lane, self.single = "lane", single

    def _worlds(self, piece: Piece) -> None:
        """Write the work for a world, balloon by balloon."""
        for of_balloon, some in groupby(piece.phases, key=lambda phase: phase.item == "balloon"):
            phases, single = tuple(some), dict(self.single)
            if of_balloon:
                self.line("for balloon in range(tables.inflation_kind.shape[0]):")
            with self.deeper(int(of_balloon)):
                self.calls(phases)
                self.keep_of_one(name for phase in phases for name in phase.keeps)
                for name in [name for phase in phases for name in phase.writes if name in piece.leaves]:
                    self._leave_of_world(name)
            self.single = single

    def _leave_of_world(self, name: str) -> None:
        """Write a result of a balloon of a world to where it is kept, for all lanes that hold the world."""
        kept = f"all_{name}[{self.row}, balloon]"
        if self.layout.worlds:
            self.line(f"{kept} = set_lane({kept}, place, its_{name})")
        else:
            self.line("for lane in range(LANE_COUNT):")
            self.line(f"    {kept} = set_lane({kept}, lane, its_{name})")

    def names(self) -> dict[str, Any]:
        """Return the objects that the text refers to, by name."""
        step, layout = self.step, self.layout
        features, look = step.features, step.look
        phases = [phase for piece in step.pieces for phase in piece.phases]
        structs, places = lane_structs(layout), places_of(layout)
        read_frame, write_frame = frame_functions(features, layout)
        params_of, params_of_quad, params_of_one = params_functions_of(features.columns.places["mass"], layout)
        types = written_types(step) | {name: kind for phase in step.light for name, kind in phase.writes.items()}
        return {
            **self.scope(phases), **balloon_functions(layout),
            "LaneTables": structs.tables, "Solids": Solids, "Seen": layout.vector,
            "Lanes3": Lanes3, "LANE_COUNT": LANE_COUNT,
            "read_frame": read_frame, "write_frame": write_frame, "show_solids": showing_function(features, layout),
            "params_of": params_of, "params_of_quad": params_of_quad, "params_of_one": params_of_one,
            "world_in_lane": places.world, "worlds_of": places.worlds, "first_world": places.first_world,
            "is_there": places.is_there, "particle_in_lane": places.particle, "totals_of": places.totals,
            "of_item": of_item, "put_item": put_item, "of_particle": of_particle, "view_of": view_of,
            "of_lane": of_lane, "set_lane": set_lane, "scaled": scaled,
            **{f"{name}_lanes": IN_LANES[kind] for name, kind in types.items()},
            **{name: function for each in features.keeps for name, function in kept_functions(each, layout).items()},
            **{f"{each.name}_may_act": each.asked(features, look) for each in (*phases, *step.light) if each.rare},
        }  # fmt: skip


@cache
def kernel_of(step: Step, layout: Layout) -> Any:
    """Make the kernel that advances groups of worlds, or worlds."""
    writer = FrameWriter(step, layout)
    return kernel_from(writer.name, writer.source(), writer.names(), module_options=OPTIONS)


@cache
def arguments_of(step: Step, layout: Layout) -> dict[str, str]:
    """Return the names of its arguments, in order, and their types."""
    writer = FrameWriter(step, layout)
    writer.source()
    return writer.arguments()


def source_of(step: Step, layout: Layout) -> str:
    """Write the kernel of a list."""
    return FrameWriter(step, layout).source()


def kinds_of(step: Step, layout: Layout) -> dict[str, tuple[Item, Any]]:
    """Return the owners and types of the kept values."""
    seen = FrameWriter(step, layout).seen
    return {
        value: (step.owner(value), layout.vector if value in seen else IN_LANES[kind])
        for value, kind in values_of(step).items()
    }
