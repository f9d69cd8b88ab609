"""Data only: the intermediate representations that the stages hand to each other."""
