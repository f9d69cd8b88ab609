"""What tests of several packages share."""

from __future__ import annotations

import pytest

from pirlc.simulation.torcs.installation import Installation
from tests.support.torcs import prepared_or_skipped


@pytest.fixture(scope="session")
def torcs_installation() -> Installation:
    """TORCS as `pirlc torcs install` prepares it; without it the test is skipped."""
    return prepared_or_skipped()
