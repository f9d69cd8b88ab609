"""Which rules lead to which: circles among them, found without recursion."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

Graph = Mapping[str, Sequence[str]]
"""The names that each name leads to."""


def circles(graph: Graph) -> Iterator[list[str]]:
    """Ways from a name back to itself, its first name repeated at the end.

    At least one for each set of names that lead to each other; linear in the size of the graph.
    """
    done: set[str] = set()
    for start in graph:
        path: list[str] = []
        on_path: set[str] = set()
        waiting = [(start, False)]
        while waiting:
            name, leaving = waiting.pop()
            if leaving:
                path.pop()
                on_path.discard(name)
            elif name in on_path:
                yield [*path[path.index(name) :], name]
            elif name not in done:
                done.add(name)
                path.append(name)
                on_path.add(name)
                waiting.append((name, True))
                waiting.extend((target, False) for target in reversed(graph[name]))


def components(graph: Graph) -> list[set[str]]:
    """The sets of names that lead to each other; a name alone only if it leads to itself.

    Kosaraju's algorithm: names in the order in which a depth-first walk leaves them, latest first,
    each with what still reaches it.
    """
    left: list[str] = []
    seen: set[str] = set()
    for start in graph:
        waiting = [(start, False)]
        while waiting:
            name, leaving = waiting.pop()
            if leaving:
                left.append(name)
            elif name not in seen:
                seen.add(name)
                waiting.append((name, True))
                waiting.extend((target, False) for target in graph[name])
    sources: dict[str, list[str]] = {name: [] for name in graph}
    for name, targets in graph.items():
        for target in targets:
            sources[target].append(name)
    found: list[set[str]] = []
    for name in reversed(left):
        if name not in seen:
            continue
        component: set[str] = set()
        reaching = [name]
        while reaching:
            member = reaching.pop()
            if member in seen:
                seen.discard(member)
                component.add(member)
                reaching.extend(sources[member])
        if len(component) > 1 or name in graph[name]:
            found.append(component)
    return found
