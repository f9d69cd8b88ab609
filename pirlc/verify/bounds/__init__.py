"""The tightest values that actions reach."""
