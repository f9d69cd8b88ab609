"""TORCS, the open racing car simulator, as an environment and as a place to race natively."""
