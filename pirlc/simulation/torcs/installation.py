"""Where a usable TORCS is on this machine."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

HOST = "pirlc"
"""The name of the host robot's module."""


@dataclass(frozen=True)
class Installation:
    """`binary`: torcs-bin. `shared`: the folder of its shared libraries. `tree`: a folder of links
    with the modules and the drivers, the host robot among them. `data`: tracks, cars and drivers'
    settings, as the package has them.
    """

    binary: Path
    shared: Path
    tree: Path
    data: Path

    @property
    def tracks(self) -> dict[str, str]:
        """The category of each track."""
        found = self.data.glob("tracks/*/*/*.xml")
        return {p.parent.name: p.parent.parent.name for p in found if p.stem == p.parent.name}

    @property
    def cars(self) -> tuple[str, ...]:
        found = self.data.glob("cars/*/*.xml")
        return tuple(sorted(p.stem for p in found if p.stem == p.parent.name))


def installed() -> Installation:
    """The installation that `pirlc torcs install` prepared."""
    cache = Path.home() / ".cache" / "pirlc" / "torcs"
    system = Path("/usr/lib/x86_64-linux-gnu/torcs")
    return Installation(
        system / "torcs-bin", system / "lib", cache / "tree", Path("/usr/share/games/torcs")
    )
