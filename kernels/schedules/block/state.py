"""Code of a block that takes particles from the state as a frame begins, and puts them back as it ends."""

from balloon_warp.kernels.schedules.block.groups import GroupsInBlock


class StateInBlock(GroupsInBlock):
    """Write how particles come from the state, and go back."""

    def _take_particles(self) -> None:
        if not self.layout.held:
            self.line("first = read_own(t, world, wp.min(thread, count - 1))")
            with self._over("particle"):
                self.line(f"put_in_tile(points, particle, state.points[world, {self.number}])")
                if "velocity" in self.layout.tiles:
                    self.line(f"put_in_tile(velocities, particle, state.velocities[world, {self.number}])")
        for place in self.places:
            with self.about(place):
                self._take_particle(place)
        if self.layout.film and self.layout.film.quads:
            self.line(f"films = hold_films(t, world, {self.own_of_any()}.n, thread)")
        if self.traits.spheres:
            self.line("spheres = share_spheres(t, state, world, thread)")
        if self.alone:
            with self.about(0):
                for name in ("balloon", "ramp", "origin_place"):
                    self.need(name)
        if self.keeps_load:
            self.line("gas_load = load_in(state, world, balloon)")
            self.known.add("gas_load")

    def _take_particle(self, number: int) -> None:
        """Write how a thread takes one of the particles that it keeps; where there is none, one that does not move."""
        b = self.bound
        self._find_particle(number)
        first_own = self.own_of_any()
        whose = f"read_own(t, world, {b('particle')})"
        if number and self.alone:
            whose = f"read_own_beside(t, {first_own}, {b('particle')})"
        self.line(f"{b('own')} = take_place({whose}, {b('is_there')})")
        self.line(f"{b('springs')} = read_springs(t, slots, {b('own')}, {b('place')}, {b('is_there')})")
        self.line(f"{b('point')} = state.points[world, {b('particle')}]")
        self.line(f"{b('velocity')} = state.velocities[world, {b('particle')}]")
        self.line(f"put_in_tile(points, {b('place')}, {b('point')})")
        self.known |= {b(name) for name in ("place", "is_there", "particle", "own", "springs", "point", "velocity")}
        self._take_kept()

    def _find_particle(self, number: int) -> None:
        """Write which particle a thread takes, and where in the tile."""
        b = self.bound
        self.line(f"{b('place')} = thread" + (f" + {number * self.layout.threads}" if number else ""))
        self.line(f"{b('is_there')} = {b('place')} < count")
        self.line(f"{b('particle')} = wp.min({b('place')}, count - 1)")

    def _put_particles(self) -> None:
        for phase in self.notes:
            self._by_one_thread(phase)
        if self.traits.spheres:
            self.line(f"put_spheres(state, world, thread, spheres, {self.traits.penalties})")
        for place in self.places:
            with self.about(place):
                b = self.bound
                self.line(f"if {b('is_there')}:")
                self.line(f"    state.points[world, {b('particle')}] = {b('point')}")
                self.line(f"    state.velocities[world, {b('particle')}] = {b('velocity')}")
                for name in self.kept_of_particles:
                    self._put_kept(name)
        if not self.layout.held:
            with self._over("particle"):
                self.line(f"state.points[world, {self.number}] = in_tile({self.points[0]}, particle)")
                if self._velocities_wait_elsewhere:
                    self.line(f"state.velocities[world, {self.number}] = {self.read('velocity')}")
