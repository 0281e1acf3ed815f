"""A few frames of a scene or of a GPU case of the bench, for a profiler to look at.

METRICS=smsp__inst_executed.sum,smsp__issue_active.avg.pct_of_peak_sustained_active
ncu -k regex:advance_ -s 2 -c 1 --metrics $METRICS python -m balloon_warp.benchmarks.profiled SCENE [DEVICE]
"""

import sys

from balloon_warp.benchmarks.auto import VARIANTS
from balloon_warp.benchmarks.cases import GPU_CASES, Case
from balloon_warp.benchmarks.rubber import RubberCase
from balloon_warp.errors import InputError
from balloon_warp.model import Model, build_model, initial_state
from balloon_warp.scene.load import load_scene
from balloon_warp.schedules.choose import fastest_schedule, make_schedule
from balloon_warp.system.warp_setup import quiet_warp
from balloon_warp.system.warp_threads import pick_device

WORLDS = 1024
"""of a scene"""
FRAMES = 3


def named(name: str, device: str | None) -> tuple[Model, str]:
    """Return the case or the scene, and its schedule.

    Raises:
        InputError: there is none of this name.
    """
    for case in GPU_CASES:
        if isinstance(case, Case | RubberCase) and case.name == name:
            return build_model(case.scene(), pick_device(device), case.worlds), case.schedule
    source, overrides = VARIANTS.get(name, (name, {}))
    model = build_model(load_scene(source, overrides), pick_device(device), WORLDS)
    return model, fastest_schedule(model, WORLDS)


def main() -> None:
    """Advance a case, and print its size, for instructions by particle and substep."""
    quiet_warp()
    if len(sys.argv) < 2:
        sys.exit("expected the name of a scene or of a case, then perhaps a device")
    try:
        model, schedule = named(sys.argv[1], sys.argv[2] if len(sys.argv) > 2 else None)
    except InputError as mistake:
        sys.exit(str(mistake))
    state, taken = initial_state(model), make_schedule(model, schedule)
    for _ in range(FRAMES):
        taken.advance_frame(state)
    state.points.numpy()
    steps = model.world_count * model.particle_count * model.substeps
    print(f"{sys.argv[1]}: {schedule}, {model.world_count:,} worlds of {model.particle_count:,} particles, ", end="")
    print(f"{model.substeps} substeps: {steps:,} particle-substeps a frame")


if __name__ == "__main__":
    main()
