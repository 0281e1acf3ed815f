"""Functions that rooms beside the core lend to its methods, by name: the package's face fills the table."""

from collections.abc import Callable
from typing import Any

LENT: dict[str, Callable[..., Any]] = {}
"""Pictures of a frame, `snapshot` and `notebook_picture`, and `stiffness_in`, a balloon's stiffness operator"""
