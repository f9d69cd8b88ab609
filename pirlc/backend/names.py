"""Identifiers of emitted code: every one is made here from a checked name.

What is reserved in one target is renamed in that target alone, by the same rule everywhere: a
trailing underscore, then numbers where that is taken too.
"""

from __future__ import annotations

import builtins
import keyword
import re
import sys
from collections.abc import Iterable
from hashlib import sha256

from pirlc.backend.problems import BadIdentifier, error
from pirlc.ir.policy import Interface

LONGEST = 63
"""The significant characters of an identifier in C99; longer names are cut and told apart."""

_IDENTIFIER = re.compile(r"[A-Za-z_][A-Za-z0-9_]*\Z", re.ASCII)

_C_KEYWORDS = """
    auto break case char const continue default do double else enum extern float for goto if inline
    int long register restrict return short signed sizeof static struct switch typedef union
    unsigned void volatile while alignas alignof bool constexpr false nullptr static_assert
    thread_local true typeof typeof_unqual asm fortran
    and and_eq bitand bitor catch char8_t char16_t char32_t class co_await co_return co_yield compl
    concept const_cast consteval constinit decltype delete dynamic_cast explicit export friend
    mutable namespace new noexcept not not_eq operator or or_eq private protected public
    reinterpret_cast requires static_cast template this throw try typeid typename using virtual
    wchar_t xor xor_eq final override import module
"""

_C_MACROS = """
    linux unix i386 NULL EOF NAN INFINITY HUGE HUGE_VAL HUGE_VALF HUGE_VALL MAXFLOAT DOMAIN SING
    OVERFLOW UNDERFLOW PLOSS TLOSS X_TLOSS DECIMAL_DIG errno complex imaginary I noreturn
    isfinite isinf isnan isnormal signbit fpclassify isgreater isgreaterequal isless islessequal
    islessgreater isunordered math_errhandling signgam near far interrupt huge
"""

_C_FUNCTIONS = """
    acos asin atan atan2 cos sin tan acosh asinh atanh cosh sinh tanh exp exp2 expm1 frexp ilogb
    ldexp log log10 log1p log2 logb modf scalbn scalbln cbrt fabs hypot pow sqrt erf erfc lgamma
    tgamma ceil floor nearbyint rint lrint llrint round lround llround trunc fmod remainder remquo
    copysign nan nextafter nexttoward fdim fmax fmin fma gamma j0 j1 jn y0 y1 yn drem finite
    significand scalb abs labs main index time clock
"""

_C_HEADERS = """
    assert complex ctype errno fenv float inttypes iso646 limits locale math setjmp signal stdalign
    stdarg stdatomic stdbool stddef stdint stdio stdlib stdnoreturn string tgmath threads time uchar
    wchar wctype
"""

_C_PREFIXES = ("FP_", "FLT_", "DBL_", "LDBL_", "M_", "MATH_")

C_RESERVED = frozenset((_C_KEYWORDS + _C_MACROS).split())
C_LOCAL_RESERVED = C_RESERVED | frozenset(_C_FUNCTIONS.split())
PYTHON_RESERVED = frozenset((*keyword.kwlist, *keyword.softkwlist, *dir(builtins), "self", "print"))


def check_names(interface: Interface, parameters: Iterable[str]) -> None:
    """Raises a diagnostic for the first name of a program that is no ASCII identifier."""
    sensors, actions = interface.sensors, interface.actions
    declared = (*(sensor.name for sensor in sensors), *(action.name for action in actions))
    for name in (interface.name, *declared, *parameters):
        checked(name)


def checked(name: str) -> str:
    """The name, if it is an ASCII identifier; else a diagnostic.

    No name ends in emitted code otherwise, whatever the front end let through.
    """
    if not _IDENTIFIER.match(name):
        raise error(BadIdentifier(name))
    return name


def _plain(name: str) -> str:
    """Without what C, C++ or Python reserve by form: leading and double underscores."""
    plain = re.sub("__+", "_", checked(name))
    if plain.startswith("_"):
        plain = "u" + plain
    if len(plain) > LONGEST:
        plain = f"{plain[: LONGEST - 9]}_{sha256(name.encode()).hexdigest()[:8]}"
    return plain


class Identifiers:
    """One namespace of emitted code: hands out identifiers, each once."""

    def __init__(self, reserved: Iterable[str], prefixes: tuple[str, ...] = ()) -> None:
        self._taken = set(reserved)
        self._prefixes = prefixes

    def fresh(self, name: str) -> str:
        """An identifier that is still free, as close to the name as may be."""
        plain = _plain(name)
        if plain.startswith(self._prefixes):
            plain = _plain("u_" + plain)
        identifier, number = plain, 1
        while identifier in self._taken:
            suffix = "_" if number == 1 else f"_{number}"
            identifier, number = _plain(plain[: LONGEST - len(suffix)] + suffix), number + 1
        self._taken.add(identifier)
        return identifier

    def assign(self, names: Iterable[str]) -> dict[str, str]:
        """An identifier for each name; names that need no change come first and keep theirs."""
        listed = list(dict.fromkeys(names))
        given = {}
        for name in listed:
            free = name not in self._taken and not name.startswith(self._prefixes)
            if _plain(name) == name and free:
                given[name] = self.fresh(name)
        return {name: given[name] if name in given else self.fresh(name) for name in listed}


def c_members() -> Identifiers:
    """A namespace for the members of one C struct."""
    return Identifiers(C_RESERVED, _C_PREFIXES)


def c_locals(taken: Iterable[str]) -> Identifiers:
    """A namespace for the locals of a C function, beside those that it has already."""
    return Identifiers({*C_LOCAL_RESERVED, *taken}, _C_PREFIXES)


def python_locals(taken: Iterable[str]) -> Identifiers:
    """A namespace for the locals of a Python function."""
    return Identifiers({*PYTHON_RESERVED, *taken})


def file_stem(policy: str) -> str:
    """What the emitted files and the names in the C header begin with.

    No standard header's name and no standard Python module's, since files of the same folder may
    come before those; nor `bridge`, the file beside it in a library. Compared without case, as some
    file systems do.
    """
    reserved = {*C_LOCAL_RESERVED, *PYTHON_RESERVED, *_C_HEADERS.split(), *sys.stdlib_module_names}
    reserved.add("bridge")
    stem = _plain(policy).rstrip("_")
    if stem.lower() in {name.lower() for name in reserved} or stem.startswith(_C_PREFIXES):
        stem = _plain(f"policy_{stem}")
    return stem
