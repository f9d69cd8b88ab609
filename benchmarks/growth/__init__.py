"""How time and memory grow with the work: `python -m benchmarks.growth`.

Each figure is the processor time and the peak memory of a process of its own (a fork of one that
has loaded the libraries and nothing else), so other work on the machine moves it little.
"""
