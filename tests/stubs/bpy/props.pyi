"""Blender's module as the type checker sees it, with or without it: anything."""

from typing import Any

def __getattr__(name: str) -> Any: ...
