"""Wording of counts, durations and arguments."""

from balloon_warp.beginning import Beginning

BLENDERS_RATE = 24.0
"""Frame rate at which Blender plays a stage by default, regardless of that of the stage [1/s]"""

OPTIONS = {name: f"--{name}" for name in (
    "cluster", "device", "every", "export", "font", "format", "gpus", "origin", "schedule", "seed", "table",
    "trajectories", "workers",
)} | {"on_blowup": "--on-blowup", "world_count": "--worlds"}  # fmt: skip
"""Options by the arguments of Python's functions that they are passed to"""


def with_options(sentence: str) -> str:
    """Write arguments as options of the command line, where a sentence begins with one and its value, or several."""
    at_fault, colon, rest = sentence.partition(":")
    named = [(*each.partition(" "),) for each in at_fault.split(", ")]
    if named[0][0] not in OPTIONS or not (named[0][1] or named[1:]):
        return sentence
    return ", ".join(OPTIONS.get(name, name) + space + value for name, space, value in named) + colon + rest


def counted(count: int, noun: str) -> str:
    """Return a count with its noun, such as `1 frame`, `2,000 frames` and `2 bodies`."""
    many = f"{noun.removesuffix('y')}ies" if noun.endswith("y") else f"{noun}s"
    return f"{count:,} {noun if count == 1 else many}"


def played(frames: int, rate: float, hint: bool = True) -> str:
    """Return the duration of a stage and its rate, and with `hint` a remedy where Blender plays it at another."""
    said = f"{frames / rate:.3g} s at {rate:g} frames/s"
    return (
        said
        if rate == BLENDERS_RATE or not hint
        else f"{said}; in Blender, set the frame rate to {rate:g}, or run with --fps {BLENDERS_RATE:g}"
    )


def begun(beginning: Beginning) -> str:
    """Return all that tells one job from another in its log."""
    work = f"{counted(beginning.worlds, 'world')}, {briefly(beginning)}"
    device = f"{beginning.workers} x {beginning.device}" if beginning.workers > 1 else beginning.device
    frames = f"{counted(beginning.frames, 'frame')} at {beginning.frames_per_second:g} frames/s"
    return f"{work}, {frames}, on {device}, schedule {beginning.schedule}"


def briefly(beginning: Beginning) -> str:
    """Return the cost of a frame: particles and substeps."""
    substeps = counted(beginning.substeps, "substep")
    return f"{counted(beginning.particles, 'particle')}, {substeps} a frame"
