"""Programs to controllers."""

from pirlc.lower.lowering import lower

__all__ = ["lower"]
