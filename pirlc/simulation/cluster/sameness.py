"""What decides whether two machines compute the same numbers."""

from __future__ import annotations

import platform
from functools import cache
from hashlib import sha256
from importlib import metadata
from pathlib import Path

import pirlc

_PACKAGES = ("numpy", "scipy", "gymnasium", "casadi", "cmaes", "optuna", "z3-solver", "joblib")
"""Those whose numbers end up in a result, and joblib, whose objects travel."""

Traits = tuple[tuple[str, str], ...]
"""What is compared, each with what it is here."""


@cache
def traits() -> Traits:
    """Of this process and its machine."""
    libc = " ".join(platform.libc_ver()) or "no libc"
    return (
        ("Python", platform.python_version()),
        ("kind of machine", f"{platform.system()} {platform.machine()} {libc}"),
        ("pirlc", f"{pirlc.__version__} ({_digest()[:12]})"),
        *((name, _version(name)) for name in _PACKAGES),
    )


def _version(package: str) -> str:
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return "none"


def _digest() -> str:
    """Of the sources, since a checkout changes without a new version."""
    root = Path(pirlc.__file__).parent
    found = sha256()
    for path in sorted(root.rglob("*.py")):
        found.update(path.relative_to(root).as_posix().encode() + b"\0" + path.read_bytes())
    return found.hexdigest()


def first_difference(here: Traits, there: Traits) -> tuple[str, str, str] | None:
    """What differs, and how it is on either side."""
    other = dict(there)
    for what, own in here:
        if other.get(what) != own:
            return what, own, other.get(what, "none")
    return None
