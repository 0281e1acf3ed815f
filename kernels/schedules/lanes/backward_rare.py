"""Phases backwards that do not take eight at a time: lane by lane, where anything in the lanes needs them."""

import inspect

from balloon_warp.kernels.adjoint import Adjoint
from balloon_warp.kernels.schedules.launched.backward_writer import BackwardWriter
from balloon_warp.kernels.schedules.launched.trace import Entry, arguments_of, is_bar

ITEM = "item"
"""Variable of the loop over items"""
ALIKE = {"t": "tables", "state": "state", "working": "working", "time": "time", "end": "end"}
"""Arguments that are the same in all lanes, and their variables"""


class TurnsOneByOne(BackwardWriter):
    """Write the turns of rare phases."""

    def _takes_eight(self, entry: Entry) -> bool:
        return entry.phase.takes_eight(self.step.features, self.step.look)

    def _call_one_by_one(self, entry: Entry) -> None:
        """Write the call of a rare phase for each lane, where any needs it."""
        phase = entry.phase
        self.called[phase.name] = phase.function(self.step.features, self.step.look)
        texts = [self._of_one(name, variable) for name, variable in entry.reads.items()]
        results = dict(zip(entry.writes.values(), entry.writes, strict=True))
        for variable, name in results.items():
            self.line(f"{variable} = {self.have(entry.reads[name]) if name in entry.reads else self._zero(name)}")
        self._in_lanes(entry, f"{phase.name}({', '.join(texts)})", list(results))
        self.known |= set(results)

    def _turn_one_by_one(self, entry: Entry, adjoint: Adjoint) -> None:
        """Write the call of a rare phase's adjoint for each lane, where any needs it, and add up its results."""
        phase, function = entry.phase, f"{entry.phase.name}_adjoint_{entry.adjoints.index(adjoint) + 1}"
        self.called[function] = adjoint.function
        self.line(f"# Backwards, one by one: {phase.summary}")
        texts = []
        for name in arguments_of(adjoint):
            texts.append(self._of_one(name, "" if is_bar(name) else entry.seen[name], self._told(entry, name)))
        results = {name: f"{function}_{name}" for name in adjoint.of}
        for name, result in results.items():
            if name == "params":
                for place in range(len(self.columns)):
                    self.line(f"{result}_{place} = Lanes()")
            else:
                stays = name in phase.writes and name in phase.reads(self.step.features, self.step.look)
                self.line(f"{result} = {self._bar(entry.writes[name], name) if stays else self._zero(name)}")
        self._in_lanes(entry, f"{function}({', '.join(texts)})", list(results.values()))
        for name, result in results.items():
            if name == "params":
                for place in range(len(self.columns)):
                    self.add_to_number(place, f"{result}_{place}")
            else:
                self._add_one_by_one(entry, name, result)

    def _add_one_by_one(self, entry: Entry, name: str, result: str) -> None:
        """Add to a bar: it is in place of that of a value that the phase has written."""
        self._add(entry.seen[name] if name not in entry.writes else entry.reads[name], name, result)

    def _of_one(self, name: str, variable: str, bar: str = "") -> str:
        """Return the text of an argument of a call for one lane."""
        if is_bar(name):
            return f"of_lane({bar}, lane)"
        if name == "params":
            return "params_of_one(t, lane_params, lane)"
        return ALIKE.get(name) or f"of_lane({self.have(variable)}, lane)"

    def _in_lanes(self, entry: Entry, call: str, results: list[str]) -> None:
        """Write a call for each lane, if any needs it."""
        phase = entry.phase
        if "lane_params" not in self.known:
            self.known.add("lane_params")
            self.line(f"lane_params = params_of(t, group, balloon, {ITEM})")
        asked = phase.asked(self.step.features, self.step.look)
        told = inspect.signature(asked.func).parameters
        given = {"params": "lane_params", "t": "t", "solids": "solids"}
        self.called[f"{phase.name}_may_act"] = asked
        texts = [given.get(name) or self.have(entry.reads[name]) for name in told]
        self.line(f"if {phase.name}_may_act({', '.join(texts)}):")
        self.line("    for lane in range(t.lane_count):")
        self.line(f"        if is_there(t, group, {ITEM}, lane):")
        ones = [f"one_{result}" for result in results]
        self.line(f"            {', '.join(ones)} = {call}")
        mass = self.step.features.columns.places["mass"]
        for result, one in zip(results, ones, strict=True):
            if not result.endswith("_params"):
                self.line(f"            {result} = set_lane({result}, lane, {one})")
                continue
            for place, column in enumerate(self.columns):
                more = f" + {one}.mass * of_lane(lane_params.share, lane)" if column == mass else ""
                number = f"{result}_{place}"
                self.line(f"            {number} = set_lane({number}, lane, {one}.n[{column}]{more})")
