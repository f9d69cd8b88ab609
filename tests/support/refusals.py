"""What is said to someone who is refused something."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from pirlc.diagnostics import PirlcError, render


def refused(do: Callable[[], object]) -> str:
    """The one diagnostic of what must raise a PirlcError, as it is shown."""
    with pytest.raises(PirlcError) as caught:
        do()
    (diagnostic,) = caught.value.diagnostics
    return render(diagnostic)
