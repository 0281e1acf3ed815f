"""What a hand adds to a scene, where its fields are within bounds."""

from typing import Any, TypeVar

from numpy.typing import NDArray
from pydantic import ValidationError

from balloon_warp.errors import InputError
from balloon_warp.scene import Sphere, String
from balloon_warp.scene.complaint import complaint

Body = TypeVar("Body", Sphere, String)


def new_body(kind: type[Body], **fields: Any) -> Body:
    """A sphere or string.

    Raises:
        InputError: it is too small, too heavy, or somewhere that cannot be.
    """
    try:
        return kind(**fields)
    except ValidationError as error:
        raise InputError(f"{kind.__name__.lower()}.{complaint(error, kind)}") from None


def as_vector(place: NDArray) -> tuple[float, float, float]:
    """A place or velocity as scenes have it."""
    x, y, z = (float(value) for value in place)
    return x, y, z
