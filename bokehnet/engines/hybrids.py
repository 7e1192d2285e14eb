"""Engines with networks: what stands below them, and where their networks are."""

from dataclasses import dataclass
from pathlib import Path

from bokehnet.inference.session import WEIGHTS

__all__ = ["HYBRIDS", "Hybrid"]


@dataclass(frozen=True, kw_only=True, slots=True)
class Hybrid:
    """One of them.

    Attributes:
        classical: Its classical half, as the networks that ship with the package tell it.
        name: Of the folder of these networks.
        refines: Whether an IUNet leads up to full size where there is one; without it the classical half's
            detail is kept.
    """

    classical: str
    name: str
    refines: bool = True

    @property
    def folder(self) -> Path:
        """Where the package's own networks are."""
        return WEIGHTS / self.name


# On the rays; the published method, on the scatter, without IUNet and with it.
HYBRIDS = {
    "hybrid": Hybrid(classical="rays", name="hybrid"),
    "fast": Hybrid(classical="scatter", name="neural", refines=False),
    "neural": Hybrid(classical="scatter", name="neural"),
}
