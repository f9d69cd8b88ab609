"""docs/command-line.md says what happens: its commands are run and their output compared."""

from __future__ import annotations

import re
import shlex
import shutil

import pytest

from tests.support.command_line import POLE, ROOT

TEXT = (ROOT / "docs" / "command-line.md").read_text(encoding="utf-8")


def _examples() -> list[tuple[str, list[str]]]:
    """Each command after a `$`, with the lines of output that are shown below it."""
    found: list[tuple[str, list[str]]] = []
    for block in re.findall(r"```console\n(.*?)```", TEXT, re.DOTALL):
        for line in block.splitlines():
            if line.startswith("$ "):
                found.append((line.removeprefix("$ "), []))
            else:
                found[-1][1].append(line)
    return found


def test_the_program_is_the_one_of_the_tests():
    (program,) = re.findall(r"```pirl\n(.*?)```", TEXT, re.DOTALL)
    assert program == POLE


def _timed(line: str) -> str:
    """A pattern for the line, in which a time in seconds may be another."""
    return re.sub(r"\d+\\\.\d+\\ s\b", r"\\d+\\.\\d+\\ s", re.escape(line))


@pytest.mark.skipif(not shutil.which("cc"), reason="one of the commands compiles C")
def test_commands_print_what_is_shown(pirlc, here):
    (here / "examples").symlink_to(ROOT / "examples")
    examples = _examples()
    assert len(examples) >= 7
    for command, shown in examples:
        words = shlex.split(command)
        assert words[0] == "pirlc"
        outcome = pirlc(*words[1:])
        assert (outcome.code, outcome.err) == (0, ""), command
        pattern = "".join(
            r"(?:.*\n)*?" if line == "..." else _timed(line) + r"\n" for line in shown
        )
        assert re.fullmatch(pattern, outcome.out), f"{command} printed\n{outcome.out}"
