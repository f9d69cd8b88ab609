"""Neural oracles: trained, saved as plain data, loaded from several formats.

Acting needs numpy alone; torch is imported by `train`, `dueling` and by the loaders of its files.
"""
