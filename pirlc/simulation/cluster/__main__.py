"""The driver's process. Its types are in a module of their own, for `__main__` cannot travel."""

from pirlc.simulation.cluster.driver import main

main()
