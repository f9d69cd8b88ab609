"""The experiments in TORCS of Verma et al. (ICML 2018), one command each.

python -m benchmarks.torcs.synthesise     the programs that the others race
python -m benchmarks.torcs.performance    lap times and rewards
python -m benchmarks.torcs.smoothness     deviation of the steering, and its scatter plot
python -m benchmarks.torcs.robustness     distance raced with blocked sensors
python -m benchmarks.torcs.transfer       races on tracks that were not trained on
python -m benchmarks.torcs.environment    how fast the simulator is, and that nothing grows
"""
