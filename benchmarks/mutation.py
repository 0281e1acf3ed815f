"""Mutation test: the source with one fault at a time, drawn by a seed, and the tests that execute the place.

    python -m balloon_warp.benchmarks.mutation [--count 60] [--seed N] [--processes P] [--full] [--seconds S]
        [--list] [--traced FILE] [--write FILE]

First all tests run once, and which functions each executes is noted, see `traced_tests`; `--traced` keeps that, and
takes it from there the next time. Then each mutant, in a copy of the tree of its own, faces the tests that execute the
mutated function, the quickest and most particular first, until one fails or S seconds of the processor are over. A
mutant that cannot be imported, crashes or hangs is found, too; one is not whose test fails without it as well. `--full`
runs `pytest --full` instead of the default suite. `--write` keeps results as they come, and goes on from there.

Prints a table and the survivors. Ends with status 1 if fewer are found than `LEAST`, those left out that change nothing
(`EQUIVALENT`).

Kernels run on the CPU. All processes share Warp's kernel cache, which a mutant enters under names of its own.
"""

import argparse
import json
import os
import sys
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path

from balloon_warp.benchmarks.mutant_tests import ROOT, Verdict, judge_all, trace
from balloon_warp.benchmarks.mutants import Stratum, draw
from balloon_warp.benchmarks.traced_tests import Traced
from balloon_warp.errors import InputError

STRATA = (
    Stratum("laws", 0.20, ("kernels/laws/*.py",)),
    Stratum("phases", 0.15, ("kernels/phases/*.py",)),
    Stratum("loops", 0.15, ("kernels/loops/*.py",)),
    Stratum("contact", 0.15, ("kernels/contact/*.py",)),
    Stratum("algebra", 0.05, ("kernels/algebra.py",)),
    Stratum("frames", 0.05, ("kernels/frame.py", "kernels/steering.py")),
    Stratum("springs", 0.08, ("balloon_warp/springs/*.py",)),
    Stratum("model", 0.10, ("balloon_warp/model/*.py",)),
    Stratum(
        "tables", 0.07,
        tuple(f"balloon_warp/schedules/{name}.py" for name in (
            "framing", "layouts", "membranes", "slices", "tables", "touch_table",
        )),
    ),
)  # fmt: skip
"""Groups of mutated files, with their shares of the mutants"""
LEAST = {"default": 0.90, "full": 0.97}
"""Share of the mutants that each suite has to find"""
EQUIVALENT: Mapping[str, str] = {
    "kernels/contact/edges.py clear_substeps: (t.touch.slack[balloon] + t.touch.slack[other]) * t.step_seconds -> "
    "(t.touch.slack[balloon] + t.touch.slack[other]) / t.step_seconds": "fewer substeps are passed over; contacts "
    "are the same",
    "kernels/contact/free_frames.py judge_kernel.judge_worlds: 0.0 -> 0.1": "a bound of the speed: fewer frames are "
    "free, which has no other result",
    "kernels/contact/spheres.py : wp.constant(8) -> wp.constant(9)": "as many particles share a mark, on either side",
    "kernels/loops/holding.py contacts_function.list_contacts: count - 1 -> count + 1": "samples of an obstacle take "
    "the place of those at which it differs",
    "balloon_warp/springs/even.py : 0.01 -> 0.012": "a tolerance",
    "kernels/contact/boxes.py sweep_of: t.particles.offsets[balloon] + first -> t.particles.offsets[balloon] - first":
    "the only thread of a block on a CPU is the first, 0",
    "kernels/contact/free_frames.py room_of_group: wp.max(first, own.groups[other]) -> "
    "wp.min(first, own.groups[other])": "pairs are looked at twice: the least of their gaps is the same",
    "kernels/laws/touch.py : 1.0e-3 -> 0.0012": "a tolerance",
    "kernels/contact/triangles.py faced_triangle: faced(place, corners[0], corners[1], corners[2]) -> "
    "faced(place, corners[0], corners[2], corners[1])": "a search reads the gap, which has no corners in it",
    "kernels/phases/forces.py jet_of_holes.jet_of_holes: state.bursts[params.world, params.balloon][1] -> "
    "state.bursts[params.world, params.balloon][0]": "the thrust of no hole is nothing",
    "balloon_warp/model/plan.py _pressed: max_pressure(bound, float(masses[row % len(masses), balloon]), "
    "model.step_seconds) -> max_pressure(float(masses[row % len(masses), balloon]), bound, model.step_seconds)":
    "a product of the two",
    "kernels/phases/inflation.py seal_air_in: air[1] / of_world[columns[1]] -> air[1] * of_world[columns[1]]":
    "the air of a given pressure is adiabatic: its free volume has no temperature in it",
    "kernels/phases/motion.py may_any_meet: pair // count < pair % count -> pair // count >= pair % count": "a pair is "
    "seen from the other side, and a sphere that meets itself has no collision",
    "kernels/contact/edges.py displacement_of_edge: ends[0] -> ends[1]": "more edges search",
    "kernels/contact/free_frames.py : 40.0 -> 48.0": "a bound with room: two edges are 40 thicknesses",
    "kernels/contact/triangles.py search_margin: SEARCH_MARGIN * t.touch.slack[balloon] -> "
    "SEARCH_MARGIN / t.touch.slack[balloon]": "a search looks farther than it has to, and finds the same contacts",
    "balloon_warp/schedules/layouts.py _add_membranes: model.balloon_count + 1 -> model.balloon_count + 2":
    "an entry more, which nothing reads",
    "kernels/laws/touch.py impact: beside + gain * normal -> beside": "friction takes what is across the normal",
    "kernels/contact/edges.py contact_function.particle_of_pair: before[0] -> before[1]": "the area vector of a "
    "triangle's sides is the same from each corner",
    "balloon_warp/model/touch.py _ridges_of_mesh: _across(a, b, points[apex[side]]) -> "
    "_across(b, a, points[apex[side]])": "a distance from a line does not depend on its direction",
    "kernels/steering.py drawn: first + second * wp.randn(state) -> first - second * wp.randn(state)": "a draw "
    "that is symmetric about its mean",
    "balloon_warp/schedules/touch_table.py : 300.0 -> 360.0": "folded balloons are searched more often, for the "
    "same contacts",
    "kernels/laws/membrane.py : 20.0 -> 24.0": "how large an exponent somebody may ask for, with room",
    "balloon_warp/model/touch.py _form: max(float(points.max()), 1e-30) -> min(float(points.max()), 1e-30)": "meshes "
    "that differ in size are looked at one by one, for the same answer",
    "kernels/loops/contact.py solid_contact_function.stand: with_another(partner, ON_GROUND) -> "
    "with_another(ON_GROUND, partner)": "which of two is met first makes no difference",
    "balloon_warp/springs/even.py _inverse: LEAST**2 -> LEAST**3": "a divisor below all that count",
    "balloon_warp/springs/build.py build_hinges: beside[0] -> beside[1]": "a face without a corner beside an edge goes "
    "along it there and back: it is both of the edge's faces",
    "balloon_warp/model/shape.py spring_sums: 1.0 -> 0.9": "a divisor of nothing",
    "kernels/phases/forces.py wear: 0.0 -> 0.1": "0.1 Pa of an energy density that softens rubber from 1e3 Pa on",
}  # fmt: skip
"""Mutants that change nothing that anyone could notice, by `Mutant.key`, and why"""


def table(verdicts: Sequence[Verdict]) -> str:
    """Return a table of mutants, and the survivors with their differences."""
    lines = ["| place | operator | before | after | found by | seconds |", "|---|---|---|---|---|---|"]
    for each in sorted(verdicts, key=lambda each: each.place):
        by = each.by if each.found else f"nothing: {EQUIVALENT.get(each.key, each.by)}"
        cells = (each.place, each.operator, f"`{_short(each.old)}`", f"`{_short(each.new)}`", by, f"{each.seconds:.0f}")
        lines.append(f"| {' | '.join(cell.replace('|', '/') for cell in cells)} |")
    for each in verdicts:
        if not each.found:
            lines.append(f"\n{each.key}\n{each.difference}\n  {EQUIVALENT.get(each.key, each.by)}")
    return "\n".join(lines)


def _short(text: str, most: int = 60) -> str:
    return text if len(text) <= most else f"{text[: most - 3]}..."


def share_found(verdicts: Sequence[Verdict]) -> float:
    """Return the share of the mutants that change anything which are found."""
    found = sum(each.found for each in verdicts)
    return found / max(1, sum(each.found or each.key not in EQUIVALENT for each in verdicts))


def main(arguments: Sequence[str]) -> int:
    """Print the table; return 1 if too many survive."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--count", type=int, default=60, help="of mutants")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--processes", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--full", action="store_true", help="the whole suite, as pytest --full")
    parser.add_argument("--seconds", type=float, default=100.0, help="of the processor for a mutant")
    parser.add_argument("--list", action="store_true", help="the mutants alone")
    parser.add_argument("--traced", type=Path, help="file of what the tests execute, written if it is not there")
    parser.add_argument("--write", type=Path, help="file of JSON for the results; what it has is not judged again")
    asked = parser.parse_args(arguments)
    if min(asked.count, asked.processes, asked.seconds) < 1:
        parser.error("--count, --processes and --seconds must be at least 1")
    for path in filter(None, (asked.traced, asked.write)):
        if not path.absolute().parent.is_dir():
            parser.error(f"{path}: its folder is not there")
    if not (ROOT / "tests").is_dir():
        parser.error(f"needs a checkout, with its tests (got {ROOT})")
    mutants = draw(ROOT, STRATA, asked.count, asked.seed)
    if asked.list:
        print("\n".join(f"{each.path}:{each.line} {each.operator}: {each.old} -> {each.new}" for each in mutants))
        return 0
    options = ["--full"] if asked.full else []
    if asked.traced and asked.traced.exists():
        traced = [Traced(**each) for each in json.loads(asked.traced.read_text())]
    else:
        try:
            traced = trace(ROOT, asked.processes, options)
        except InputError as mistake:
            parser.error(str(mistake))
        if asked.traced:
            asked.traced.write_text(json.dumps([asdict(each) for each in traced]))
    known = json.loads(asked.write.read_text()) if asked.write and asked.write.exists() else []
    keys = {each.key for each in mutants}
    verdicts = [Verdict(**each) for each in known if each["key"] in keys]
    left = [each for each in mutants if each.key not in {verdict.key for verdict in verdicts}]
    for verdict in judge_all(ROOT, left, traced, asked.processes, asked.seconds, options):
        verdicts.append(verdict)
        print(f"[{len(verdicts)}/{len(mutants)}] {'found' if verdict.found else 'SURVIVES'} {verdict.place} "
              f"{verdict.operator}: {verdict.by}, {verdict.seconds:.0f} s", flush=True)  # fmt: skip
        if asked.write:
            asked.write.write_text(json.dumps([asdict(each) for each in verdicts], indent=1))
    share, least = share_found(verdicts), LEAST["full" if asked.full else "default"]
    print(f"\n{table(verdicts)}\n\n{sum(each.found for each in verdicts)} of {len(verdicts)} mutants found, "
          f"{share:.0%} of those that change anything; at least {least:.0%} must be")  # fmt: skip
    return 0 if share >= least else 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
