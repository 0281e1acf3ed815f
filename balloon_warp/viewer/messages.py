"""Messages that a window may send: six kinds, of numbers and words within bounds. All else is ignored."""

from collections.abc import Callable
from typing import Annotated, Any, Literal

import msgspec

MOST_BYTES = 1 << 16
"""Largest size of a message [bytes]; those of a browser have a few hundred"""

Real = Annotated[float, msgspec.Meta(ge=-1e12, le=1e12)]
"""Number as in the scene; neither NaN nor infinite"""
Word = Annotated[str, msgspec.Meta(max_length=300)]
Pixel = tuple[Real, Real]
Place = tuple[Real, Real, Real]
Few = Annotated[list[Real], msgspec.Meta(max_length=4)]


class Said(msgspec.Struct, tag=True, tag_field="type", forbid_unknown_fields=True):
    """A message, named as viser names it, with viser's fields."""


class ViewerCameraMessage(Said):
    """Place of a window's camera."""

    wxyz: tuple[Real, Real, Real, Real]
    position: Place
    fov: Real
    near: Real
    far: Real
    image_height: Real
    image_width: Real
    look_at: Place
    up_direction: Place


class ScenePointerMessage(Said):
    """A click into the scene."""

    event_type: Literal["click"]
    ray_origin: Place
    ray_direction: Place
    screen_pos: tuple[Pixel]
    modifier: Word | None


class SceneNodeDragMessage(Said):
    """A balloon is dragged."""

    phase: Literal["start", "update", "end"]
    name: Word
    instance_index: None
    start_position: Place
    start_screen_pos: Pixel
    end_position: Place
    end_screen_pos: Pixel
    button: Literal["left", "middle", "right"]
    modifier: Word | None
    owner: Word = ""


class Updates(msgspec.Struct, forbid_unknown_fields=True):
    """Update of a control, of which only the value may change."""

    value: bool | Real | Word | Few


class GuiUpdateMessage(Said):
    """A control of the panel is moved, or a button pressed."""

    uuid: Word
    updates: Updates


class GuiButtonHoldMessage(Said):
    """A button of the panel is held."""

    uuid: Word
    frequency: Real


class CommandTriggerMessage(Said):
    """A key is pressed."""

    uuid: Word


_decoder = msgspec.msgpack.Decoder(
    ViewerCameraMessage
    | ScenePointerMessage
    | SceneNodeDragMessage
    | GuiUpdateMessage
    | GuiButtonHoldMessage
    | CommandTriggerMessage
)


def understood(raw: bytes, control: Callable[[str], Any]) -> bytes | None:
    """Return a message as it was understood, encoded anew so that nothing else is in it; nothing, if it makes no sense.

    Args:
        raw: as it came, in MessagePack.
        control: the control of the panel that has an id, or None.
    """
    try:
        message = _decoder.decode(raw)
    except (msgspec.MsgspecError, RecursionError, UnicodeDecodeError):
        return None
    if isinstance(message, GuiUpdateMessage) and not _takes(control(message.uuid), message.updates.value):
        return None
    return msgspec.msgpack.encode(message)


def _takes(control: Any, value: object) -> bool:
    """Return whether a control can have a value: one of its options, or one of its value's type."""
    if control is None:
        return False
    if hasattr(control, "options"):
        return value in control.options
    if isinstance(control.value, tuple):
        return isinstance(value, list) and len(value) == len(control.value)
    if isinstance(control.value, bool):
        return isinstance(value, bool)
    return isinstance(value, float)
