"""Emitted C = program."""

from pirlc.verify.emitted.check import check_emitted, check_text

__all__ = ["check_emitted", "check_text"]
