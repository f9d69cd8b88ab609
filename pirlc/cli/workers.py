"""Where work is done: the options that choose processes or a cluster."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import wraps
from typing import TYPE_CHECKING, Any

import click

from pirlc.cli.machine import cores

if TYPE_CHECKING:
    from pirlc.simulation.workers import Workers

Command = Callable[..., Any]


@dataclass(frozen=True)
class Place:
    """This machine, or the cluster at `address`; `count` None is one worker a core there."""

    count: int | None
    address: str | None

    @contextmanager
    def workers(self, usual: int | None = None) -> Iterator[Workers]:
        """Those that were chosen, until the work is done; `usual` instead of one a core here.

        Raises PirlcError E0545 to E0547.
        """
        from pirlc.simulation.workers import Workers

        if self.address is None:
            yield Workers(self.count or usual or cores())
            return
        from pirlc.simulation.cluster.backend import RayBackend

        with RayBackend(self.address, self.count) as backend:
            yield Workers(backend.at_once, backend)


def place_options(command: Command) -> Command:
    """`--workers`, `--backend` and `--ray-address`, as the parameter `place`."""

    @wraps(command)
    def joined(
        *args: Any, workers: int | None, backend: str, ray_address: str | None, **rest: Any
    ) -> Any:
        if ray_address is not None and backend != "ray":
            raise click.UsageError("--ray-address makes no sense without --backend ray.")
        address = ray_address or os.environ.get("RAY_ADDRESS") or "auto"
        place = Place(workers, address if backend == "ray" else None)
        return command(*args, place=place, **rest)

    for option in (
        click.option(
            "--ray-address",
            metavar="ADDRESS",
            help="Of the cluster, HOST:PORT (default: $RAY_ADDRESS, else the one that this machine "
            "is part of).",
        ),
        click.option(
            "--backend",
            type=click.Choice(["loky", "ray"]),
            default="loky",
            show_default=True,
            help="Processes of this machine, or of a Ray cluster.",
        ),
        click.option(
            "--workers",
            type=click.IntRange(1, 1024),
            help="Processes to use (default: one a core).",
        ),
    ):
        joined = option(joined)
    return joined
