"""The command line: arguments, progress and exit codes; the work is done by the packages below.

Command modules import heavy libraries only inside their functions, so that `pirlc check`,
`pirlc fmt`, `pirlc explain` and `pirlc emit` start at once.
"""

from __future__ import annotations

from collections.abc import Sequence

import click

import pirlc
from pirlc.cli import (
    analyze,
    check,
    emit,
    explain,
    explain_program,
    fmt,
    oracle,
    report,
    rollout,
    synth,
    torcs,
    verify,
)
from pirlc.cli.guard import guarded
from pirlc.cli.session import Session

__all__ = ["main"]


@click.group(
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100},
    epilog="Example: pirlc check examples/cartpole.pirl",
)
@click.version_option(pirlc.__version__, "-V", "--version", prog_name="pirlc")
def program() -> None:
    """Compile policy sketches into controllers.

    A sketch (a .pirl file) says what is known about a policy and leaves the rest open; pirlc
    searches the programs that it allows and emits C and Python.
    """


for _command in (
    check.command,
    fmt.command,
    explain.command,
    explain_program.command,
    synth.command,
    emit.command,
    rollout.command,
    analyze.command,
    verify.command,
    report.command,
    oracle.group,
    torcs.group,
):
    program.add_command(_command)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line (without `arguments`: the process's own) and return its exit code.

    0: done; 1: refused, with diagnostics; 2: wrong usage; 70: a fault of pirlc; 130: interrupted.
    """
    session = Session()

    def run() -> int:
        outcome = program.main(
            None if arguments is None else list(arguments),
            prog_name="pirlc",
            standalone_mode=False,
            obj=session,
        )
        return outcome if isinstance(outcome, int) else 0

    return guarded(run, session)
