"""What tests of several packages share."""

from __future__ import annotations

import signal

import pytest

from pirlc.simulation.torcs.installation import Installation
from tests.support.torcs import prepared_or_skipped


def pytest_configure() -> None:
    """A shell's background jobs ignore Ctrl-C, and so does all that they start. Tests of
    interruptions need it as it is in a terminal.
    """
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture(scope="session")
def torcs_installation() -> Installation:
    """TORCS as `pirlc torcs install` prepares it; without it the test is skipped."""
    return prepared_or_skipped()
