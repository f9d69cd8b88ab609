"""`pirlc synth`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from pirlc.cli.arguments import argument_option
from pirlc.cli.guard import INTERRUPTED, TIMEOUT
from pirlc.cli.session import Session, json_option, pass_session
from pirlc.cli.settings import settings_option
from pirlc.cli.workers import place_options


@click.command("synth", epilog="Example: pirlc synth examples/cartpole.pirl -o runs/cartpole")
@click.argument("sketch")
@click.option(
    "-o", "--output", "folder", required=True, type=click.Path(path_type=Path),
    help="The folder of this run. If it was interrupted, the same command resumes it.",
)  # fmt: skip
@click.option(
    "--oracle", "origin", metavar="PATH",
    help="An oracle to use: a folder, an ONNX file, ...; or `train`. Default: one in the folder "
    "`oracles` beside the sketch that fits, else one is trained.",
)  # fmt: skip
@click.option("--no-oracle", is_flag=True, help="Search by simulated return alone.")
@click.option("--algorithm", metavar="NAME", help="Train the oracle with this algorithm.")
@click.option("--oracle-steps", type=click.IntRange(1), help="Train for this many steps at most.")
@click.option("--oracle-seed", type=click.IntRange(0), help="Of the training (default: --seed).")
@settings_option
@click.option(
    "--seed", type=click.IntRange(0), default=0, show_default=True, help="Of everything random."
)
@click.option(
    "--time", "seconds", type=click.FloatRange(0, min_open=True),
    help="Stop the search after this many seconds.",
)  # fmt: skip
@click.option(
    "--budget", "calls", type=click.IntRange(1),
    help="Stop the search after this many tunings and simulations.",
)  # fmt: skip
@click.option("--max-size", type=click.IntRange(1, 1000), help="Nodes of a program, at most.")
@click.option("--pool", type=click.IntRange(1), help="Templates tried at first (default: 160).")
@click.option(
    "--optimizer", type=click.Choice(["auto", "casadi", "bayes", "smt"]), default="auto",
    show_default=True,
    help="Finds the parameters of a template; auto: the one that measures best.",
)  # fmt: skip
@click.option(
    "--trials", type=click.IntRange(1),
    help="Programs that `bayes` tries for a template (default: 200).",
)  # fmt: skip
@click.option(
    "--effort", type=click.IntRange(1),
    help="What `smt` may spend on a template, in z3's units of work (default: 1000000, a second "
    "or two).",
)  # fmt: skip
@click.option(
    "--tolerance", type=click.FloatRange(0, 1, min_open=True),
    help="`smt` is content with a continuous action this close to the oracle's, as a part of its "
    "range (default: 0.05).",
)  # fmt: skip
@click.option(
    "--tune-seconds", type=click.FloatRange(0, min_open=True),
    help="`bayes` and `smt` stop after this long at a template.",
)  # fmt: skip
@click.option(
    "--episodes", type=click.IntRange(1),
    help="Unseen episodes for the evaluation at the end (default: 1000; 50 in TORCS; 1 where "
    "chance plays no part).",
)  # fmt: skip
@place_options
@click.option(
    "--pick", type=click.IntRange(1), metavar="N",
    help="Take program N of the front (a shorter one for a little return) in place of the "
    "search's own; also of a run that has ended, where nothing is searched again.",
)  # fmt: skip
@click.option("--no-augment", is_flag=True, help="Tune on the oracle's own histories alone.")
@click.option(
    "--no-sketch", is_flag=True,
    help="Search the language's own grammar over the sketch's sensors and actions.",
)  # fmt: skip
@click.option("--no-if", is_flag=True, help="Search only the programs that have no `if`.")
@click.option("--no-refine", is_flag=True, help="Leave out the refinement on simulated return.")
@argument_option
@click.option("--trust", is_flag=True, help="Let environments and oracles run their own code.")
@json_option
@pass_session
def command(session: Session, /, sketch: str, **options: Any) -> int:
    """Find a program for SKETCH, and write it with C, Python and the evidence under DIR.

    An oracle is trained (or found in the cache), programs are searched that imitate it, and the
    best is refined and evaluated. Ctrl-C ends the search with the best program so far.
    """
    from pirlc.cli.synthesis import TRAIN, Wish, synthesize_for
    from pirlc.search.synthesis import Ending

    wish = Wish(sketch=sketch, **options)
    training = (wish.algorithm, wish.oracle_steps, wish.oracle_seed, wish.settings or None)
    given = wish.origin is not None and wish.origin != TRAIN
    if (given or wish.no_oracle) and any(choice is not None for choice in training):
        raise click.UsageError("options of the training make no sense without a training.")
    if wish.origin and wish.no_oracle:
        raise click.UsageError("--oracle and --no-oracle exclude each other.")
    chosen = None if wish.optimizer == "auto" else wish.optimizer
    tuning = (chosen, wish.trials, wish.effort, wish.tolerance, wish.tune_seconds)
    if wish.no_oracle and any(choice is not None for choice in tuning):
        raise click.UsageError(
            "--optimizer and its options make no sense with --no-oracle: parameters are then found "
            "by return."
        )
    if wish.no_oracle and wish.no_augment:
        raise click.UsageError(
            "--no-augment makes no sense with --no-oracle: nobody says what to do in new histories."
        )
    match synthesize_for(session, wish):
        case Ending.INTERRUPTED:
            return INTERRUPTED
        case Ending.TIMEOUT:
            return TIMEOUT
        case _:
            return 0
