"""TORCS for tests: prepared once, in the user's cache; a test that needs it says so with
`torcs_installation`.
"""

from __future__ import annotations

import pytest

from pirlc.diagnostics import PirlcError
from pirlc.simulation.torcs.install import install
from pirlc.simulation.torcs.installation import Installation, installed

_ABSENT = ("E0520", "E0521")
"""TORCS or its source cannot be had here; what else goes wrong is a failure."""


def prepared_or_skipped() -> Installation:
    try:
        install()
    except PirlcError as error:
        (diagnostic, *_) = error.diagnostics
        if diagnostic.code not in _ABSENT:
            raise
        reasons = "; ".join(diagnostic.notes) or diagnostic.help
        pytest.skip(f"needs TORCS: {diagnostic.message} ({reasons})")
    return installed()
