"""`pirlc rollout`."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Literal

import click

from pirlc.cli.arguments import Arguments, argument_option
from pirlc.cli.session import Session, json_option, pass_session
from pirlc.cli.workers import Place, place_options

_WORTH_PROCESSES = 100
"""Episodes from which on starting further processes pays."""


@click.command(
    "rollout", epilog="Example: pirlc rollout cartpole.pirl --episodes 100 --seed 0 --as c"
)
@click.argument("policy")
@click.option(
    "--episodes",
    type=click.IntRange(1, 10_000_000),
    default=1000,
    show_default=True,
    help="How many.",
)
@click.option(
    "--seed",
    type=click.IntRange(0, 2**62),
    default=1_000_000,
    show_default=True,
    help="Seed of the first episode; each further one adds 1.",
)
@click.option(
    "--as",
    "form",
    type=click.Choice(["interpreter", "python", "c"]),
    help="What runs a program: the reference interpreter, emitted Python (the default), or "
    "emitted C, compiled and loaded.",
)
@click.option(
    "--sketch",
    "--environment-from",
    "sketch",
    metavar="FILE",
    help="The .pirl file whose environment to act in; for an emitted C file, its program.",
)
@click.option(
    "--real",
    type=click.Choice(["double", "float"]),
    default="double",
    show_default=True,
    help="The numbers that a program computes in.",
)
@place_options
@argument_option
@click.option("--trust", is_flag=True, help="Let environments and policies run their own code.")
@json_option
@pass_session
def command(
    session: Session,
    policy: str,
    episodes: int,
    seed: int,
    form: Literal["interpreter", "python", "c"] | None,
    sketch: str | None,
    real: Literal["double", "float"],
    place: Place,
    arguments: Arguments,
    trust: bool,
) -> None:
    """Run POLICY in its environment and say what return it reaches.

    POLICY is a program (.pirl), an emitted controller (.c, with its .h beside it), or an oracle: a
    folder of `pirlc oracle train`, an ONNX file, or with --trust a Stable-Baselines3 .zip, a
    TorchScript file or `module:function`.
    """
    from pirlc.cli import measure
    from pirlc.cli.subjects import Request, find_subject

    usual = None if episodes >= _WORTH_PROCESSES else 1
    with tempfile.TemporaryDirectory(prefix="pirlc-") as built:
        request = Request(policy, form, sketch, real, trust, Path(built), arguments)
        subject = find_subject(session, request)
        seeds = range(seed, seed + episodes)
        with place.workers(usual) as workers:
            tally = measure.measure(subject, seeds, workers, trust)
    session.say(measure.in_words(subject, tally))
    session.finish(measure.as_data(subject, tally))
