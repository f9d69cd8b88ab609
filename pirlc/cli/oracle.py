"""`pirlc oracle`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from pirlc.cli.arguments import Arguments, argument_option
from pirlc.cli.session import Session, json_option, pass_session
from pirlc.cli.settings import settings_option


@click.group("oracle")
def group() -> None:
    """Train oracles, and list those that there are."""


@group.command(
    "train", epilog="Example: pirlc oracle train cartpole.pirl --algorithm ppo -o oracle"
)
@click.argument("sketch")
@click.option("--algorithm", metavar="NAME", help="ppo, dqn, duel-ddqn, td3, sac or ddpg.")
@click.option("--steps", type=click.IntRange(1), help="Environment steps of an attempt, at most.")
@click.option("--seed", type=click.IntRange(0), default=0, show_default=True)
@settings_option
@argument_option
@click.option(
    "-o", "--output", type=click.Path(path_type=Path),
    help="The folder to save the oracle in (default: pirlc's cache).",
)  # fmt: skip
@click.option("--trust", is_flag=True, help="Let an environment `module:id` run its code.")
@json_option
@pass_session
def train(
    session: Session,
    sketch: str,
    algorithm: str | None,
    steps: int | None,
    seed: int,
    settings: dict[str, Any],
    arguments: Arguments,
    output: Path | None,
    trust: bool,
) -> None:
    """Train an oracle for SKETCH's environment, or find it among those trained before."""
    from pirlc.cli.oracles import Wish, train_for

    overrides = settings if steps is None else {**settings, "steps": steps}
    train_for(session, sketch, Wish(algorithm, seed, overrides, output, trust, arguments))


@group.command("list", epilog="Example: pirlc oracle list")
@click.argument("folder", required=False, type=click.Path(path_type=Path))
@json_option
@pass_session
def list_(session: Session, folder: Path | None) -> None:
    """List the oracles in FOLDER (default: pirlc's cache), with what they reach."""
    from pirlc.cli.oracles import show_stored

    show_stored(session, folder)
