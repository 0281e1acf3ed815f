"""Check of the schedule `auto`: every bundled scene, alone and in batches, with each schedule of the device.

    python -m balloon_warp.benchmarks.auto [DEVICE [WORLDS,WORLDS,...]]

ends with status 1 where another is faster by more than it may be.
"""

import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import warp as wp

from balloon_warp.benchmarks.measure import seconds_a_frame
from balloon_warp.benchmarks.result import Result
from balloon_warp.model import Model, State, build_model, initial_state
from balloon_warp.scene.load import bundled_scenes, load_scene
from balloon_warp.schedules.choose import LAUNCHED, fastest_schedule, make_schedule, only_launched
from balloon_warp.schedules.layouts import fits_in_block
from balloon_warp.system.warp_setup import quiet_warp
from balloon_warp.system.warp_threads import pick_device

WORLDS = (1, 64, 1024)
MOST = 1.05
"""time of `auto` over that of the fastest"""
ON_CPU, ON_GPU = ("gather", "lanes", "octets"), ("gather", "block")
"""measured schedules; `scatter` is for reading"""
VARIANTS: dict[str, tuple[str, dict[str, Any]]] = {
    "squirrel_inflate, pressure": (
        "squirrel_inflate",
        {"balloon.inflation": {"kind": "pressure", "pressure": 100.0}},
    ),
    "squirrel_inflate, gas": (
        "squirrel_inflate",
        {"balloon.helium": 0.0, "balloon.inflation": {"kind": "gas", "start_pressure": 100.0}},
    ),
    "squirrel_inflate, viscous": ("squirrel_inflate", {"balloon.stiffness.viscosity": 1e-3}),
    "sphere_launch, impulse": ("sphere_launch", {"contact": "impulse"}),
}
"""bundled scenes with other physics"""
FRAME_SECONDS = 0.2
"""approximate time of the frames that are timed together"""
FRAMES_BEFORE = 60
"""that a GPU simulates first of balloons that touch, until they do"""


@dataclass(frozen=True)
class Choice:
    """Choice of `auto` for a scene and a number of worlds, beside the fastest."""

    scene: str
    worlds: int
    particles: int
    """in one world"""
    taken: str
    rates: dict[str, float]
    """particle-substeps a second, by schedule"""

    @property
    def loss(self) -> float:
        """Rate of the fastest over that of the schedule taken."""
        return max(self.rates.values()) / self.rates[self.taken]


def measure(name: str, worlds: int, device: wp.Device) -> Choice:
    """Return the rates of the schedules, measured in turns."""
    source, overrides = VARIANTS.get(name, (name, {}))
    model = build_model(load_scene(source, overrides), device, worlds)
    named = ON_CPU if device.is_cpu else ON_GPU
    if only_launched(model) or (device.is_cuda and not fits_in_block(model)):
        named = tuple(schedule for schedule in named if schedule in LAUNCHED)
    schedules = [make_schedule(model, schedule) for schedule in named]
    work = model.world_count * model.particle_count * model.substeps
    frames = max(1, min(20, int(FRAME_SECONDS * (3e7 if device.is_cpu else 5e9) / work)))
    seconds = seconds_a_frame(schedules, frames, [_begun(each, model) for each in schedules])
    rates = {schedule.name: work / each for schedule, each in zip(schedules, seconds, strict=True)}
    return Choice(name, worlds, model.particle_count, fastest_schedule(model, worlds), rates)


def _begun(schedule: Any, model: Model) -> State:
    """Return a state from which to measure."""
    state = initial_state(model)
    for _ in range(FRAMES_BEFORE if model.scene.touches and model.device.is_cuda else 0):
        schedule.advance_frame(state)
    return state


def measured_scenes() -> list[str]:
    """Return the bundled scenes and the variants, by their names."""
    return sorted([*bundled_scenes(), *VARIANTS])


def scene_results(device: wp.Device, counts: Sequence[int] = WORLDS) -> Iterator[Result]:
    """Yield the results of every bundled scene and variant in each schedule, beside the one that `auto` takes.

    Each scene is simulated so many times side by side.
    """
    for name in measured_scenes():
        for worlds in counts:
            choice = measure(name, worlds, device)
            taken = choice.rates[choice.taken]
            for schedule, rate in choice.rates.items():
                peer = (f"auto: {choice.taken}", taken, rate / taken)
                yield Result(name, str(device), schedule, worlds, choice.particles, rate, *peer)


def main() -> None:
    """Print a table; status 1 where `auto` loses more than it may."""
    quiet_warp()
    device = pick_device(sys.argv[1] if len(sys.argv) > 1 else None)
    counts = [int(count) for count in sys.argv[2].split(",")] if len(sys.argv) > 2 else WORLDS
    names = ON_CPU if device.is_cpu else ON_GPU
    print(f"| scene | worlds | {' | '.join(names)} | auto | the best over it |\n|{'---|' * (len(names) + 4)}")
    choices = []
    for name in measured_scenes():
        for worlds in counts:
            choices.append(choice := measure(name, worlds, device))
            rates = " | ".join(f"{choice.rates[each]:.3g}" if each in choice.rates else "-" for each in names)
            print(f"| {name} | {worlds:,} | {rates} | {choice.taken} | {choice.loss:.2f} |", flush=True)
    sys.exit(0 if all(choice.loss <= MOST for choice in choices) else 1)


if __name__ == "__main__":
    main()
