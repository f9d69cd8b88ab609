"""What stands between emitted files and the folder they are written to."""

from __future__ import annotations

from collections.abc import Sequence

from pirlc.backend.files import GeneratedFile
from pirlc.backend.names import file_stem
from pirlc.backend.numbers import RealType
from pirlc.ir.policy import Program
from pirlc.verify.emitted.check import check_text
from pirlc.verify.emitted.problems import NotTheProgram, error
from pirlc.verify.findings import EmittedFinding


def compared(
    program: Program, files: Sequence[GeneratedFile], real: RealType = "double"
) -> EmittedFinding | None:
    """What is known of the C among the files, None where there is none.

    Raises `PirlcError` (E0915) unless that C is shown to be the program; only a program too large
    to compare gets by, with evidence that says so.
    """
    stem = file_stem(program.interface.name)
    texts = {file.path.name: file.text for file in files}
    if f"{stem}.c" not in texts:
        return None
    finding = check_text(program, texts[f"{stem}.h"], texts[f"{stem}.c"], real)
    if finding.differences:
        raise error(NotTheProgram(program.interface.name, finding))
    return finding
