"""Ctrl-C while z3 is at work is the user's, not z3's."""

import os
import signal
import threading

import pytest
import z3

from pirlc.symbolic import z3_terms


def test_ctrl_c_during_a_question_is_not_lost():
    context = z3.Context()
    solver = z3.Solver(ctx=context)
    # More pigeons than holes: far more work than the limit allows.
    holes = 11
    inside = [[z3.Bool(f"{i} in {j}", context) for j in range(holes)] for i in range(holes + 1)]
    solver.add(*(z3.Or(row) for row in inside))
    for hole in range(holes):
        for one in range(holes + 1):
            for other in range(one):
                solver.add(z3.Or(z3.Not(inside[one][hole]), z3.Not(inside[other][hole])))
    solver.set("timeout", 1500)
    assert z3_terms.number  # Importing it settles whose the signal is.
    interrupt = threading.Timer(0.3, os.kill, (os.getpid(), signal.SIGINT))
    interrupt.start()
    with pytest.raises(KeyboardInterrupt):
        solver.check()
    interrupt.join()
