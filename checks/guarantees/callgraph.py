"""Call graph and stack use, from the files that GCC writes with -fcallgraph-info=su,da."""

import re
from collections.abc import Iterable
from pathlib import Path

Graph = dict[str, tuple[int, set[str]]]


def call_graph(files: Iterable[Path]) -> Graph:
    """Return function -> bytes of its own frame, callees; for functions of the same name the largest frame
    and all callees.

    Functions of libraries are callees only. Raises RuntimeError for a frame of variable size.
    """
    graph: Graph = {}
    for file in files:
        text = file.read_text(encoding="utf-8")
        if grows := re.search(r'title: "([^"]*)" label: "[^"]*\(dynamic\)', text):
            raise RuntimeError(f"{grows[1]} allocates on the stack as it runs")
        for title, stack in re.findall(r'node: \{ title: "([^"]*)" label: "[^"]*\\n(\d+) bytes', text):
            own, callees = graph.get(_plain(title), (0, set()))
            graph[_plain(title)] = (max(own, int(stack)), callees)
        for caller, callee in re.findall(r'edge: \{ sourcename: "([^"]*)" targetname: "([^"]*)"', text):
            graph.setdefault(_plain(caller), (0, set()))[1].add(_plain(callee))
    return graph


def reached(graph: Graph, name: str) -> set[str]:
    """Return the function and all functions it calls, directly or indirectly."""
    found, left = set(), [name]
    while left:
        if (function := left.pop()) not in found:
            found.add(function)
            left += graph.get(function, (0, ()))[1]
    return found


def deepest(graph: Graph, name: str, callers: tuple[str, ...] = ()) -> int:
    """Return the bytes of stack of the deepest call chain. Raises RuntimeError for recursion."""
    if name in callers:
        raise RuntimeError(f"recursion: {' -> '.join((*callers, name))}")
    own, callees = graph.get(name, (0, ()))
    return own + max((deepest(graph, callee, (*callers, name)) for callee in callees), default=0)


def _plain(title: str) -> str:
    return title.rpartition(":")[2]
