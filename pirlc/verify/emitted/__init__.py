"""Emitted C is the program: shown for all inputs, states and parameters.

What is compared
    The text of the header and the source, parsed and executed on nodes instead of numbers
    (`machine`), and the program, evaluated on the same nodes by the interpreter's rules
    (`meaning`), without a look at the controller in between: `lower`, the printer and the templates
    are all under test. Nodes are hash-consed and conditions canonical (`graph`), so that two equal
    results are one object. Nothing is sampled; there is no solver.

What is proved
    1. `<name>_default_params` holds the program's parameters, rounded to the precision.
    2. After `<name>_reset` the C's state stands for the program's initial state (`relation`).
    3. From any state that stands for one of the program's, on any readings (NaN and infinities
       too) and any parameters, `<name>_step` gives the same actions, the same status and the same
       flags, bit for bit, and its state then again stands for the program's.
    By induction the two agree after a reset for ever.
    4. On the way: no index lies outside its array, no variable is read before it is set, no integer
       overflows or wraps (with an `int` of 16 bits; where it takes 32, the evidence says so), all
       loops end. No shift, no division of integers, no pointer arithmetic occurs.
    5. The source refuses, with #error, the compilers and options on which it would mean something
       else, and turns contraction off.

Under which assumptions
    The C compiler follows C99 with its annex F, rounding to nearest, on a platform that the source
    admits: each operation is rounded once to the precision of its type. `fabs`, `sqrt`, `exp` and
    `tanh` are the same functions for both. NaNs are not told apart. The four pointers point to
    different objects. The state was reset, and is changed by `<name>_step` alone. Readings come in
    the type of the header.

What is not understood is a difference: nothing is skipped. Two sides that are equal for a reason
that is not modelled (algebra, say) count as different, which emitted C never relies on; so a wrong
"proved" is what cannot be, a wrong "not shown" is a fault to mend. On a difference the C is also
executed with constants beside the interpreter (`example`), in search of a run that shows it.
"""

from pirlc.verify.emitted.check import check_emitted, check_text

__all__ = ["check_emitted", "check_text"]
