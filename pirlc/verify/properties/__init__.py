"""Properties: proved by z3, refuted by a history that replays, or tried on many."""
