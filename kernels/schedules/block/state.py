"""Code of a block that takes particles from the state as a frame begins, and puts them back as it ends."""

from balloon_warp.kernels.schedules.block.groups import GroupsInBlock


class StateInBlock(GroupsInBlock):
    """Write how particles come from the state, and go back."""

    def _take_particles(self) -> None:
        if not self.layout.held:
            self.line("first = read_params(t, world, wp.min(thread, count - 1))")
            with self._over("particle"):
                self.line(f"put_in_tile(points, particle, state.points[world, {self.number}])")
                if "velocity" in self.layout.tiles:
                    self.line(f"put_in_tile(velocities, particle, state.velocities[world, {self.number}])")
        for place in self.places:
            with self.about(place):
                self._take_particle(place)
        if self.layout.membrane_face and self.layout.membrane_face.quads:
            self.line(f"membrane_faces = hold_membrane_faces(t, world, {self.params_of_any()}.n, thread)")
        if self.features.spheres:
            self.line(f"spheres = share_spheres(t, state, world, thread, {self.features.penalties})")
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
        first_params = self.params_of_any()
        whose = f"read_params(t, world, {b('particle')})"
        if number and self.alone:
            whose = f"read_params_beside(t, {first_params}, {b('particle')})"
        self.line(f"{b('params')} = take_place({whose}, {b('is_there')})")
        kept = "kept" if self.layout.membrane_face else "springs"
        self.line(f"{b(kept)} = read_springs(t, slots, {b('params')}, {b('place')}, {b('is_there')})")
        self.line(f"{b('point')} = state.points[world, {b('particle')}]")
        self.line(f"{b('velocity')} = state.velocities[world, {b('particle')}]")
        self.line(f"put_in_tile(points, {b('place')}, {b('point')})")
        self.known |= {b(name) for name in ("place", "is_there", "particle", "params", kept, "point", "velocity")}
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
        if self.features.spheres:
            self.line(f"put_spheres(state, world, thread, spheres, {self.features.penalties})")
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
