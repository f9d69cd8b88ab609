from pirlc.diagnostics import Diagnostic, Label
def describe(found, source):
    p = found.problem
    return Diagnostic("E0000", repr(p)+str(found.context), source, Label(p.span) if hasattr(p,'span') else None)
