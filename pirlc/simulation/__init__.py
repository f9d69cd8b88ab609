"""Environments and rollouts: of programs, of compiled controllers and of oracles alike."""
