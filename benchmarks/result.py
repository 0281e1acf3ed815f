"""Result of a case."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any


@dataclass(frozen=True)
class Result:
    """A case's figures. The more, the better, but for a rate in seconds."""

    case: str
    """with the unit of the rate in brackets, where that is not particle-substeps a second"""
    device: str
    schedule: str
    worlds: int
    particles: int
    """in one world"""
    rate: float
    peer: str | None = None
    peer_rate: float | None = None
    ratio: float | None = None
    """rate over the peer's"""
    bound_fraction: float | None = None
    overlap: float | None = None
    """how deep the deepest particle was in another balloon at the end, over the radius; none where nothing touches"""
    peer_overlap: float | None = None

    def as_json(self) -> dict:
        return asdict(self)


def beside(peer: str, rates: Sequence[float]) -> dict[str, Any]:
    """Return a result's fields of rates: ours, and a peer's that took part."""
    ours, *others = rates
    if not others:
        return {"rate": ours}
    return {"rate": ours, "peer": peer, "peer_rate": others[0], "ratio": ours / others[0]}
