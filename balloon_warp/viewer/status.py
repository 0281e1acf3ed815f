"""Status line of the panel, and the list of keys."""

from html import escape

from balloon_warp.viewer import colors
from balloon_warp.viewer.picture import Picture

KEYS = (
    ("drag a balloon", "pulls it"),
    ("click", "throws a sphere there"),
    ("I K", "inflates, deflates"),
    ("space", "pauses, resumes"),
    ("N", "steps one frame"),
    ("R", "resets to the start, the camera, too"),
    ("C", "cuts the strings"),
    ("F", "follows the balloon, or stops"),
    ("?", "shows or hides the keys"),
)
"""Actions of a user and their effects"""
COMPILING = "compiling kernels; they are cached for the next time"
"""Reason why time stops for some seconds"""
KEPT_UP = 0.95
"""Fraction of the requested speed that counts as kept"""
KEYS_BUTTON = '<div class="bw-keys"><button class="bw-keys-button" title="keys">?</button></div>'
"""Button at the end of the status line, which is rewritten while a user presses it"""
NEARLY_ALL = 0.9
"""Fraction of a frame's time from which on simulation alone limits the speed"""


def status_line(picture: Picture, busy_seconds: float = 0.0) -> str:
    """Return the time and pace, in one line however long they are.

    Args:
        busy_seconds: how long a request takes by now, if it takes long.
    """
    recorded = f" · ● {picture.recorded_seconds:.1f} s" if picture.recorded_seconds is not None else ""
    pace, why = (f"getting ready: {busy_seconds:.1f} s", COMPILING) if busy_seconds else _pace(picture)
    said = f' data-busy="{escape(pace)}"' if busy_seconds else ""
    said += " data-moves" if picture.frame.number > 0 or not picture.running else ""  # page_files/wait.js reads both
    return (
        f'<div class="bw-status"{said} title="{escape(why)}">'
        f"<span><b>{picture.seconds:.2f} s</b> · {escape(pace)}{recorded}</span></div>"
    )


def row_of(count: int, large: bool = False) -> str:
    """Return the markup that puts a number of following buttons side by side; see page_files/page.css."""
    return f'<div class="bw-row-{count}{" bw-large" if large else ""}"></div>'


def trouble_line(picture: Picture) -> str:
    """Return the error; more of it is shown where a pointer rests."""
    return f'<div class="bw-trouble" role="alert" title="{escape(picture.why)}">{escape(picture.trouble)}</div>'


def _pace(picture: Picture) -> tuple[str, str]:
    """Return the speed of time, and why it is slower than requested."""
    if not picture.running:
        return "paused", ""
    if picture.rate == 0.0:
        return "…", ""
    pace = f"{picture.rate:.2f}x real time"
    if picture.rate >= KEPT_UP * picture.speed:
        return ("real time" if picture.speed == 1.0 else pace), ""
    taken, due = 1000.0 * picture.step_seconds, 1000.0 * picture.model.frame_seconds / picture.speed
    if taken >= NEARLY_ALL * due:
        return pace, f"slower than requested: a frame takes {taken:.0f} ms, and one is due every {due:.0f} ms"
    return pace, f"slower than requested: this machine is busy; simulating a frame takes {taken:.0f} ms"


def details(picture: Picture) -> str:
    """Return the sizes of the model, its schedule and its device."""
    model = picture.model
    return (
        f'<div class="bw-details">{model.particle_count:,} particles, {model.spring_count:,} springs, '
        f"{model.substeps} substeps a frame, {escape(picture.schedule)} on {escape(str(model.device))}</div>"
    )


def key_sheet() -> str:
    """Return the keys, as a table."""
    rows = "".join(f"<tr><th>{escape(key)}</th><td>{escape(does)}</td></tr>" for key, does in KEYS)
    return f'<template id="bw-keys"><table>{rows}</table></template>'


def strain_legend() -> str:
    """Return the legend of the strain bands: length over rest length."""
    bounds = ["", *(f"{bound:g}" for bound in colors.STRAIN_BOUNDS)]
    cells = "".join(
        f'<div style="flex:1;border-top:0.6em solid rgb{color};padding-right:0.2em">{bound}</div>'
        for color, bound in zip(colors.STRAIN, bounds, strict=True)
    )
    title = '<div style="font-size:0.8em;margin:0 1em">stretch: length / rest length</div>'
    return title + f'<div style="display:flex;font-size:0.7em;margin:0 1.2em 0.6em">{cells}</div>'
