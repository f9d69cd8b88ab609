"""What may be wrong with a cluster (codes E0545 to E0549)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import assert_never

from pirlc.diagnostics import Diagnostic, PirlcError


@dataclass(frozen=True)
class RayMissing:
    reason: str


@dataclass(frozen=True)
class NoCluster:
    address: str
    reason: str


@dataclass(frozen=True)
class NodeUnusable:
    """A machine of the cluster on which pirlc does not run at all."""

    node: str
    reason: str


@dataclass(frozen=True)
class NodeDiffers:
    """A machine of the cluster whose results might be others."""

    node: str
    what: str
    here: str
    there: str


@dataclass(frozen=True)
class ClusterLost:
    reason: str


@dataclass(frozen=True)
class NotShipped:
    """Work or a result that cannot be sent to another process."""

    reason: str


Problem = RayMissing | NoCluster | NodeUnusable | NodeDiffers | ClusterLost | NotShipped

_INSTALL = "install the same Python and packages on every machine: `pip install 'pirlc[ray]'`"


def describe(problem: Problem) -> Diagnostic:
    """The problem in words."""
    match problem:
        case RayMissing(reason):
            return Diagnostic(
                "E0545",
                "Ray is not installed",
                notes=(reason,),
                help="`pip install 'pirlc[ray]'`, or leave `--backend ray` out",
            )
        case NoCluster(address, reason):
            where = "on this machine" if address == "auto" else f"at `{address}`"
            return Diagnostic(
                "E0546",
                f"there is no Ray cluster {where}",
                notes=(reason,),
                help="start one with `ray start --head`, join this machine to one with "
                "`ray start --address=HOST:6379`, or leave `--backend ray` out",
            )
        case NodeUnusable(node, reason):
            return Diagnostic(
                "E0547",
                f"pirlc does not run on the node {node} of the cluster",
                notes=(reason,),
                help=_INSTALL,
            )
        case NodeDiffers(node, what, here, there):
            return Diagnostic(
                "E0547",
                f"the node {node} of the cluster has another {what}",
                notes=(f"{here} here, {there} there; results could differ",),
                help=_INSTALL,
            )
        case ClusterLost(reason):
            return Diagnostic(
                "E0548",
                "the cluster is gone",
                notes=(reason,),
                help="what was finished is kept: the same command goes on from there, on a "
                "cluster or without `--backend ray`",
            )
        case NotShipped(reason):
            return Diagnostic(
                "E0549",
                "this work cannot be sent to another machine",
                notes=(reason,),
                help="leave `--backend ray` out",
            )
        case _:
            assert_never(problem)


def failure(problem: Problem) -> PirlcError:
    return PirlcError(describe(problem))
