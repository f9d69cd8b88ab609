"""Table openai of Verma et al. (ICML 2018): returns in classic control. Its TORCS tables are in
`benchmarks.torcs.paper`."""

from __future__ import annotations

DRL, SMT, BOPT, MINIMUM = "DRL", "NDPS-SMT", "NDPS-BOPT", "minimum"

ENVIRONMENTS = ("Acrobot-v1", "CartPole-v0", "MountainCar-v0")

RETURNS: dict[tuple[str, str], float] = {
    (DRL, "Acrobot-v1"): -63.17,
    (DRL, "CartPole-v0"): 197.53,
    (DRL, "MountainCar-v0"): -84.73,
    (SMT, "Acrobot-v1"): -84.16,
    (SMT, "CartPole-v0"): 183.15,
    (SMT, "MountainCar-v0"): -108.06,
    (BOPT, "Acrobot-v1"): -127.21,
    (BOPT, "CartPole-v0"): 143.21,
    (BOPT, "MountainCar-v0"): -143.86,
    (MINIMUM, "Acrobot-v1"): -200.0,
    (MINIMUM, "CartPole-v0"): 8.0,
    (MINIMUM, "MountainCar-v0"): -200.0,
}
"""The paper's Acrobot ends after 200 steps, today's after 500."""


def bar(method: str, environment: str) -> float | None:
    """What a row has to reach: the paper's own figure; for CasADi, which the paper has not, the
    better of the other two. None where there is none."""
    if method == "NDPS-CasADi":
        both = [RETURNS.get((other, environment)) for other in (SMT, BOPT)]
        known = [value for value in both if value is not None]
        return max(known) if known else None
    return RETURNS.get((method, environment)) if method in (SMT, BOPT) else None
