"""Plants: what an action does to the sensors, near an operating point."""
