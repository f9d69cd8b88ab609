"""Checks the C that pirlc emits with the tools that embedded engineers use.

    python -m benchmarks.assure [--only NAME] [--random N] [--write] [--json]

One module a tool; `subjects` are the programs whose C is checked, `outcome` what a check returns.
"""
