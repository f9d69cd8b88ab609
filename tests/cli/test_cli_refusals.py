"""What is wrong with files, arguments or the machine, and what the command line says to it."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from pirlc import resources
from pirlc.cli import problems
from pirlc.cli.guard import guarded
from pirlc.cli.session import Session
from pirlc.diagnostics import render
from pirlc.source import SourceText, Span
from tests.support.command_line import POLE, ROOT
from tests.support.processes import started

SAMPLES = [
    (
        problems.Unreadable("cartpol.pirl", "no such file or directory", "cartpole.pirl"),
        "error[E0701]: cannot read cartpol.pirl: no such file or directory\n"
        "  = help: did you mean cartpole.pirl?",
    ),
    (
        problems.NotText("photo.png", 1233),
        "error[E0702]: photo.png is not a text in UTF-8\n"
        "  = note: byte 1,234 does not belong in one\n"
        "  = help: a .pirl file is plain text; save it again as UTF-8",
    ),
    (
        problems.TooLarge("log.pirl", 4_000_000),
        "error[E0703]: log.pirl is larger than 4,000,000 bytes\n"
        "  = help: a .pirl file is a few dozen lines; is this the right file?",
    ),
    (
        problems.StillOpen(
            SourceText("a.pirl", "action A : [0, 1] = ?k"), ((Span(20, 22), "a parameter to find"),)
        ),
        "error[E0704]: this is a sketch: a program is needed, with nothing left to choose\n"
        " --> a.pirl:1:21\n"
        "  |\n"
        "1 | action A : [0, 1] = ?k\n"
        "  |                     ^^ a parameter to find\n"
        "  |\n"
        "  = help: `pirlc synth` makes a program of a sketch",
    ),
    (
        problems.SystemRefused("out", "no space left on device"),
        "error[E0705]: the system refused: out: no space left on device",
    ),
    (
        problems.OutOfMemory(),
        "error[E0706]: there is not enough memory\n"
        "  = help: ask for less (a smaller --size, fewer --workers), or close other programs",
    ),
    (
        problems.UnknownCode("E0330", "E0303"),
        "error[E0707]: no diagnostic has the code 'E0330'\n  = help: did you mean E0303?",
    ),
    (
        problems.NoSketch("pole.c", "emitted C"),
        "error[E0708]: pole.c does not say where it acts\n"
        "  = note: it is emitted C\n"
        "  = help: name its program or sketch with --sketch FILE",
    ),
    (
        problems.OtherProgram("pole.c", "pole.pirl"),
        "error[E0709]: pole.c is not what this pirlc emits from pole.pirl\n"
        "  = note: compiling it would run code that pirlc has not written\n"
        "  = help: emit it again, or give its own program with --sketch; if you trust it as it is, "
        "add --trust",
    ),
    (
        problems.NoSuchRobot("bernie", ("berniw", "bt")),
        "error[E0731]: no robot 'bernie' comes with TORCS\n"
        "  = help: these do: robot:berniw, robot:bt",
    ),
    (
        problems.NothingToBlock("rmp", "rpm"),
        "error[E0732]: 'rmp' is neither a sensor of the program nor a reading of TORCS\n"
        "  = help: did you mean rpm?",
    ),
    (
        problems.RaceBrokeOff("aalborg", "TORCS gave no answer within 20 s"),
        "error[E0733]: the race on aalborg broke off\n"
        "  = note: TORCS gave no answer within 20 s\n"
        "  = help: `pirlc torcs doctor` says what is wrong with TORCS here",
    ),
    (
        problems.NotAnArgument("track:aalborg", "it has no `=`"),
        "error[E0541]: `--argument track:aalborg` is not an argument of an environment: it has no "
        "`=`\n"
        "  = help: write KEY=VALUE, such as `--argument track=aalborg`, with a number, `true`, "
        "`false` or a text as value",
    ),
]


@pytest.mark.parametrize(("problem", "text"), SAMPLES, ids=lambda s: type(s).__name__)
def test_messages(problem, text):
    diagnostic = problems.describe(problem)
    assert render(diagnostic) == text
    page = resources.explanations() / f"{diagnostic.code}.md"
    assert page.read_text().startswith(f"# {diagnostic.code}: ")


def test_every_problem_has_a_sample():
    assert {type(problem) for problem, _ in SAMPLES} == set(problems.Problem.__args__)


COMMANDS = [
    ("check",),
    ("fmt",),
    ("emit", "-o", "out"),
    ("rollout",),
    ("oracle", "train"),
    ("rollout", "x.c", "--sketch"),
]


@pytest.mark.parametrize("command", COMMANDS, ids=" ".join)
def test_files_that_cannot_be_read(pirlc, here, command):
    (here / "folder.pirl").mkdir()
    (here / "binary.pirl").write_bytes(b"policy \xff\xfe\x00")
    (here / "x.c").write_text("")
    (here / "x.h").write_text("")
    cases = {"pole2.pirl": "E0701", "folder.pirl": "E0701", "binary.pirl": "E0702"}
    for name, code in cases.items():
        outcome = pirlc(*command, name, "--json")
        assert (outcome.code, outcome.codes) == (1, [code])
        outcome = pirlc(*command, name)
        assert (outcome.code, outcome.out) == (1, "")
        assert outcome.err.startswith(f"error[{code}]: ")
        assert name in outcome.err
    assert not (here / "out").exists()


def test_a_name_that_was_nearly_right(pirlc):
    assert "= help: did you mean pole.pirl?" in pirlc("check", "poel.pirl").err


def test_a_folder_with_one_sketch(pirlc, here):
    (here / "folder").mkdir()
    (here / "folder" / "only.pirl").write_text(POLE)
    assert "did you mean folder/only.pirl?" in pirlc("check", "folder").err


def test_files_that_are_too_large_or_odd(pirlc, here):
    (here / "large.pirl").write_bytes(b"#" * 4_000_001)
    assert pirlc("check", "large.pirl", "--json").codes == ["E0703"]
    (here / "empty.pirl").write_bytes(b"")
    assert pirlc("check", "empty.pirl").code == 1
    assert pirlc("check", "a\0b", "--json").codes == ["E0701"]
    (here / "marked.pirl").write_bytes(b"\xef\xbb\xbf" + POLE.encode())
    assert pirlc("check", "marked.pirl").code == 0
    (here / "windows.pirl").write_bytes(POLE.replace("\n", "\r\n").encode())
    assert pirlc("check", "windows.pirl").code == 0


@pytest.mark.parametrize("command", [("emit", "-o", "out"), ("rollout",)], ids=" ".join)
def test_a_sketch_where_a_program_is_needed(pirlc, here, command):
    outcome = pirlc(*command, "sketch.pirl", "--json")
    assert (outcome.code, outcome.codes) == (1, ["E0704"])
    assert outcome.data["diagnostics"][0]["at"]["line"] == 8
    assert not (here / "out").exists()


def test_all_that_is_open_is_told(pirlc):
    outcome = pirlc("emit", ROOT / "examples" / "cartpole.pirl", "-o", "out")
    for words in ("2 alternatives", "3 alternatives", "a parameter to find", "1 more left open"):
        assert words in outcome.err


def test_output_that_cannot_be_written(pirlc, here):
    assert pirlc("emit", "pole.pirl", "-o", "sketch.pirl", "--json").codes == ["E0712"]
    assert pirlc("emit", "pole.pirl", "-o", "sketch.pirl/x", "--json").codes == ["E0712"]
    if Path("/proc/self").exists():
        assert pirlc("emit", "pole.pirl", "-o", "/proc/pirlc", "--json").codes == ["E0711"]


def test_targets_that_there_are_not(pirlc, here):
    assert pirlc("emit", "pole.pirl", "-o", "out", "--target", "c,fortran", "--json").codes == [
        "E0802"
    ]
    assert pirlc("emit", "pole.pirl", "-o", "out", "--target", ",").code == 2
    assert not (here / "out").exists()


def test_no_c_compiler(process, here):
    empty = here / "empty"
    empty.mkdir()
    outcome = process(
        "rollout", "pole.pirl", "--as", "c", "--episodes", "1", "--json",
        env={"PATH": str(empty), "CC": ""},
    )  # fmt: skip
    if outcome.code == 0:
        pytest.skip("the ziglang wheel is installed: it stands in")
    assert (outcome.code, outcome.codes) == (1, ["E0803"])
    emitted = process("emit", "pole.pirl", "-o", "out", env={"PATH": str(empty), "CC": ""})
    assert emitted.code == 0


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("chek",), "Did you mean 'check'?"),
        (("check", "--enviroment", "x"), "'--environment'?"),
        (("check",), "Missing argument 'FILE'"),
        (("emit", "pole.pirl"), "Missing option '-o'"),
        (("emit", "pole.pirl", "-o", "o", "--real", "half"), "'half' is not one of"),
        (("rollout", "pole.pirl", "--episodes", "0"), "not in the range"),
        (("rollout", "pole.pirl", "--seed", "-1"), "not in the range"),
        (("oracle", "trian"), "Did you mean 'train'?"),
    ],
)
def test_wrong_usage(pirlc, arguments, words):
    outcome = pirlc(*arguments)
    assert (outcome.code, outcome.out) == (2, "")
    assert words in outcome.err


@pytest.mark.parametrize(
    "command", [(), ("check",), ("fmt",), ("explain",), ("emit",), ("rollout",),
                ("oracle",), ("oracle", "train"), ("oracle", "list")], ids=" ".join
)  # fmt: skip
def test_help_has_an_example(pirlc, command):
    outcome = pirlc(*command, "--help")
    assert outcome.code == 0
    assert command == ("oracle",) or "Example: pirlc " in outcome.out


def test_codes_that_are_not_known(pirlc):
    assert "did you mean E0" in pirlc("explain", "E0399").err
    for code in ("E9999", "", "../../etc/passwd", "E0303.md"):
        assert pirlc("explain", code, "--json").codes == ["E0707"]


def test_an_oracle_that_is_none(pirlc, here):
    (here / "noise.bin").write_bytes(b"\0\1\2")
    rollout = ("rollout", "noise.bin", "--json")
    assert pirlc(*rollout).codes == ["E0708"]
    assert pirlc(*rollout, "--sketch", "pole.pirl").codes == ["E0602"]
    assert pirlc("rollout", "nowhere", "--sketch", "pole.pirl", "--json").codes == ["E0601"]
    assert pirlc("rollout", "os:getcwd", "--sketch", "pole.pirl", "--json").codes == ["E0608"]


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs /dev/full")
@pytest.mark.parametrize("options", [(), ("--json",)])
def test_a_full_disk_behind_standard_output(process, options):
    with Path("/dev/full").open("w") as full:
        outcome = process("check", "pole.pirl", *options, stdout=full, stderr=subprocess.PIPE)
    assert outcome.code == 1
    assert outcome.err.startswith(
        "error[E0705]: the system refused: standard output: no space left on device"
    )


def test_a_reader_that_has_had_enough(here):
    read, write = os.pipe()
    os.close(read)
    with os.fdopen(write, "w") as gone:
        done = subprocess.run(
            [sys.executable, "-m", "pirlc", "explain", "E0303"],
            stdout=gone,
            stderr=subprocess.PIPE,
            text=True,
            check=False,
            env={**os.environ, "PYTHONPATH": str(ROOT)},
        )
    assert (done.returncode, done.stderr) == (1, "")


def test_interrupted(here):
    # Interpreted, this takes minutes.
    options = ["--as", "interpreter", "--episodes", "20000", "--workers", "1", "--json"]
    with started("-m", "pirlc", "rollout", "pole.pirl", *options) as running:
        time.sleep(3)
        running.send_signal(signal.SIGINT)
        out, err = running.communicate(timeout=30)
    assert running.returncode == 130
    assert '"interrupted": true' in out
    assert "Traceback" not in err


def _raise(error):
    def run() -> int:
        raise error

    return run


def test_whatever_else_happens_is_told_without_a_traceback(capfd, tmp_path, monkeypatch):
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    assert guarded(_raise(ZeroDivisionError("a secret")), Session()) == 70
    out, err = capfd.readouterr()
    assert out == ""
    (report,) = tmp_path.iterdir()
    assert err == (
        "internal error: ZeroDivisionError. This is a fault of pirlc, not of your file: please "
        "report it, with the file and the command. What happened is written down in "
        f"{report}.\n"
    )
    assert "ZeroDivisionError: a secret" in report.read_text()


@pytest.mark.parametrize(
    ("error", "words"),
    [
        (
            PermissionError(13, "Permission denied", "weights"),
            "[E0705]: the system refused: weights: permission denied",
        ),
        (OSError(28, "No space left on device"), "refused: no space left on device"),
        (MemoryError(), "[E0706]: there is not enough memory"),
    ],
)
def test_failures_of_the_system(capfd, error, words):
    assert guarded(_raise(error), Session()) == 1
    assert words in capfd.readouterr().err
