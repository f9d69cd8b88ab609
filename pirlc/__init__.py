"""pirlc compiles policy sketches into controllers."""

__version__ = "0.1.0"
