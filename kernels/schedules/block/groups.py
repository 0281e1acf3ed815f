"""Code of a block for its world, its balloons, springs, and phases of all threads."""

from itertools import groupby

from balloon_warp.kernels.phase import Phase
from balloon_warp.kernels.schedules.block.items import ItemsInBlock
from balloon_warp.kernels.schedules.pieces import Piece


class GroupsInBlock(ItemsInBlock):
    """Write phases of a whole group: by one thread for all, or by all together."""

    def _worlds(self, piece: Piece) -> None:
        """Write phases of the world and its balloons.

        With one balloon all threads compute the values, so that none waits for them.
        """
        for item, phases in groupby(piece.phases, key=lambda phase: phase.item):
            if item == "balloon" and not self.alone:
                self._over_balloons(tuple(phases))
                continue
            for phase in phases:
                if phase.writes:
                    self.calls((phase,))
                    self._keep_for_all(phase)
                elif phase in self.notes:
                    continue
                else:
                    self._by_one_thread(phase)
            if not self.alone:
                self.line("block_barrier()")
        waits = any(phase.item == "world" for phase in piece.phases) or not piece.phases[0].writes
        if self.alone and waits:
            self.line("block_barrier()")
        self.forget("load")

    def _keep_for_all(self, phase: Phase) -> None:
        """Write the kept values that all threads have found to where one of them stores them, once all have read."""
        if phase.keeps:
            self.line("block_barrier()")
            self.line("if thread == 0:")
            self.lines += [f"{self.indent}    {self.kept_at(name)} = {self.bound(name)}" for name in phase.keeps]
            self.line("block_barrier()")

    def _by_one_thread(self, phase: Phase) -> None:
        call = self.call(phase)
        self.line(f"# {phase.summary}")
        self.line(f"if {self._is_noting()}:")
        self.line(f"    {call}")

    def _is_noting(self) -> str:
        """Return whether a thread is the one that does something for the world."""
        return "thread == 0"

    def _over_balloons(self, phases: tuple[Phase, ...]) -> None:
        """Write the work for each balloon, by a warp of which one thread does it once all have the sums."""
        self.line(f"for balloon in range({self._warps_of_balloons}):")
        with self.indented():
            self.known.add("balloon")
            summed = {value for phase in self.phases if phase.sums for value in phase.writes}
            for value in dict.fromkeys(name for phase in phases for name in self.reads(phase) if name in summed):
                self.line(f"{value} = total_{value}(balloon)")
                self.known.add(value)
            self.line("if thread % WARP_THREADS == 0:")
            with self.indented():
                self.calls(phases)
                for value in (value for phase in phases for value in phase.writes if value in self.step.kept):
                    self.line(f"all_{value}[world, balloon] = {value}")
                for value in (value for phase in phases for value in phase.keeps):
                    self.line(f"{self.kept_at(value)} = {value}")
        self.line("block_barrier()")

    def _springs(self, piece: Piece) -> None:
        """Write the work on springs, color by color, on points and velocities where these are."""
        self.line("colors = t.correction.color_offsets.shape[0] - 1")
        self.line("for color_of_sweep in range(t.correction.sweeps * colors):")
        with self.indented():
            self.line("color = color_of_sweep % colors")
            self.line("begin = t.correction.color_offsets[color] + thread")
            self.line(f"for spring in range(begin, t.correction.color_offsets[color + 1], {self.layout.threads}):")
            with self.indented():
                self.known.add("spring")
                self.calls(piece.phases)
            self.line("block_barrier()")
        for place in self.places:
            with self.about(place):
                b = self.bound
                self.line(f"{b('point')} = in_tile({self.points[0]}, {b('place')})")
                self.line(f"{b('velocity')} = vector_at({self.velocities[0]}, {b('particle')})")

    def _team(self, piece: Piece) -> None:
        """Write the work of all threads with points and velocities in arrays, if there is anything to do."""
        (phase,) = piece.phases
        self.line(f"if {phase.name}_is_due({self._asked(phase)}):")
        points, velocities = self.points, self.velocities
        with self.indented():
            self._to_arrays()
            self.line("block_barrier()")
            self.points, self.velocities = ("seen_points", ""), ("seen_velocities", "")
            self.known |= {"seen_points", "seen_velocities"}
            self.calls(piece.phases)
            self.line("block_barrier()")
            self.points, self.velocities = points, velocities
            self._from_arrays()
            self.line("block_barrier()")

    def _to_arrays(self) -> None:
        self.line("seen_points = state.points[world]")
        self.line("seen_velocities = state.velocities[world]")
        for place in self.places:
            with self.about(place):
                b = self.bound
                self.line(f"if {b('is_there')}:")
                self.line(f"    put_vector(seen_points, {b('particle')}, {b('point')})")
                self.line(f"    put_vector(seen_velocities, {b('particle')}, {b('velocity')})")
        if not self.layout.held:
            with self._over("particle"):
                self.line(f"put_vector(seen_points, particle, in_tile({self.points[0]}, particle))")
                if self._velocities_wait_elsewhere:
                    self.line(f"put_vector(seen_velocities, particle, {self.read('velocity')})")

    @property
    def _velocities_wait_elsewhere(self) -> bool:
        """Return whether loops find velocities elsewhere than in the state."""
        return "velocity" in self.layout.tiles or self.velocities[0] != "velocities"

    def _from_arrays(self) -> None:
        for place in self.places:
            with self.about(place):
                b = self.bound
                self.line(f"if {b('is_there')}:")
                self.line(f"    {b('point')} = vector_at(seen_points, {b('particle')})")
                self.line(f"    {b('velocity')} = vector_at(seen_velocities, {b('particle')})")
                if self.shows_velocities and self._velocities_wait_elsewhere:
                    self.line(f"    put_vector({self.velocities[0]}, {b('particle')}, {b('velocity')})")
                self.line(f"put_in_tile({self.points[0]}, {b('place')}, {b('point')})")
        if not self.layout.held:
            with self._over("particle"):
                self.line(f"put_in_tile({self.points[0]}, particle, vector_at(seen_points, particle))")
                if self._velocities_wait_elsewhere:
                    self.line("velocity = vector_at(seen_velocities, particle)")
                    self.line(self.write("velocity", self.velocities[0]))

    @property
    def notes(self) -> tuple[Phase, ...]:
        """Return the phases that note values that all threads know anyway, for who asks once the frame has ended."""
        if not self.keeps_load or self.features.gas_changes:
            return ()
        behind = (piece for piece in self.step.pieces if piece.item == "balloon" and piece.phases[0].writes)
        return tuple(phase for piece in behind for phase in piece.phases if not phase.writes)
