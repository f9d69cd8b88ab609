"""Emits many programs from a tree, to see whether a mutant emits anything that compiles.

    python -m benchmarks.mutation.emitting

waits with what no mutant touches already loaded. For each line that it reads it forks; the child
loads the printers and the lowering as they are in the tree now, and answers with one line: "ok"
and a hash of everything emitted, or "refused" and why.
"""

from __future__ import annotations

import hashlib
import os
import random
import resource
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from pirlc.frontend import parse_sketch
from pirlc.ir.expansion import close
from pirlc.ir.policy import Program
from pirlc.ir.printer import program_text
from pirlc.source import SourceText
from tests.support.programs import random_program, renamed

RANDOM_PROGRAMS = 10
SECONDS = 20
MEMORY = 4 << 30


def programs() -> list[Program]:
    """Those of the tests, and some random ones."""
    made = []
    for path in sorted(Path("tests/backend/programs").glob("*.pirl")):
        program = close(parse_sketch(SourceText(path.name, path.read_text(encoding="utf-8"))))
        assert program is not None
        made.append(program)
    rng = random.Random(5)
    return made + [renamed(random_program(rng), f"r{k}") for k in range(RANDOM_PROGRAMS)]


def emit_all(listed: list[Program]) -> str:
    """A hash of all emitted text; raises whatever a mutant raises."""
    from pirlc.backend.c import c_files
    from pirlc.backend.files import Provenance
    from pirlc.backend.python import python_files
    from pirlc.backend.toolchain import bridge_text
    from pirlc.lower import lower

    digest = hashlib.sha256()
    with tempfile.TemporaryDirectory() as place:
        sources = []
        for number, program in enumerate(listed):
            controller = lower(program)
            for real in ("double", "float"):
                folder = Path(place, f"{number}{real}")
                folder.mkdir()
                provenance = Provenance(program_text(program))
                files = c_files(controller, real, provenance)
                for file in files:
                    (folder / file.path).write_text(file.text)
                    digest.update(file.text.encode())
                stem = files[0].path.stem
                bridge = bridge_text(controller, stem)
                (folder / "bridge.c").write_text(bridge)
                digest.update(bridge.encode())
                sources.append(folder / "bridge.c")
                for file in python_files(controller, real, provenance):
                    compile(file.text, str(file.path), "exec")
                    digest.update(file.text.encode())
        compiler = shutil.which("gcc") or shutil.which("cc") or "clang"
        command = [compiler, "-std=c99", "-w", "-fsyntax-only", *sources]
        answer = subprocess.run(command, capture_output=True, text=True)
        if answer.returncode:
            lines = [line for line in answer.stderr.splitlines() if "error" in line]
            raise ValueError("C that does not compile: " + (lines or [""])[0].split("error: ")[-1])
    return digest.hexdigest()


def main() -> None:
    import jinja2  # noqa: F401  (what the printers need is loaded once)

    listed = programs()
    print("ready", flush=True)
    for _ in sys.stdin:
        child = os.fork()
        if child == 0:
            resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
            resource.setrlimit(resource.RLIMIT_CPU, (SECONDS, SECONDS))
            try:
                answer = f"ok {emit_all(listed)}"
            except BaseException as e:
                answer = f"refused {type(e).__name__}: {e}".split("\n")[0]
            print(answer, flush=True)
            os._exit(0)
        _, status = os.waitpid(child, 0)
        if status:
            print("refused: it does not end, or takes all memory", flush=True)


if __name__ == "__main__":
    main()
