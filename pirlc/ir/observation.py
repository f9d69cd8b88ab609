"""The type of an observation vector; numpy is not loaded for it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    Observation = Sequence[float] | NDArray[np.float64]
    """All readings of one step, of shape (d,); NaN and infinities are missing ones."""
