"""Do the tests notice a fault in the templates, the printers or the lowering?

Faults are planted one at a time in a private copy of the tree, and the ordinary tests are run on
it. `python -m benchmarks.mutation` says how; docs/mutation.md what came of it.
"""
