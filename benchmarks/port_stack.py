"""Compute the stack of an exported estimator's deepest call from the call graph of gcc (-fcallgraph-info=su)."""

import re
import subprocess
from pathlib import Path

NODE = re.compile(r'node: \{ title: "([^"]+)" label: "([^"]*)"')
EDGE = re.compile(r'edge: \{ sourcename: "([^"]+)" targetname: "([^"]+)"')
USED = re.compile(r"(\d+) bytes \(([\w,]+)\)")


class Graph:
    """A call graph with the stack [bytes] of each function; of functions of other libraries it is not known."""

    def __init__(self, text: str) -> None:
        self.frames: dict[str, int] = {}
        self.unbounded: list[str] = []
        self.calls: dict[str, set[str]] = {}
        for title, label in NODE.findall(text):
            used = USED.search(label)
            if used is not None:
                self.frames[title] = int(used[1])
                self.unbounded += [title] if used[2] == "dynamic" else []  # not `static`, not `dynamic,bounded`
        for caller, called in EDGE.findall(text):
            self.calls.setdefault(caller, set()).add(called)

    def outside(self) -> set[str]:
        """Return the functions called that are not in the file."""
        return {called for of in self.calls.values() for called in of if called not in self.frames}

    def deepest(self) -> tuple[int, list[str]]:
        """Return the deepest chain of calls: its bytes, its functions; ValueError for a function that calls itself."""
        known: dict[str, tuple[int, list[str]]] = {}

        def below(name: str, above: tuple[str, ...]) -> tuple[int, list[str]]:
            if name in above:
                raise ValueError(f"{name} calls itself")
            if name not in known:
                inner = [below(called, (*above, name)) for called in sorted(self.calls.get(name, ()))]
                most, chain = max(inner, default=(0, []), key=lambda each: each[0])
                known[name] = self.frames.get(name, 0) + most, [name, *chain]
            return known[name]

        return max((below(name, ()) for name in sorted(self.frames)), key=lambda each: each[0])


def graph_of(folder: Path, compiler: str, flags: list[str]) -> Graph:
    """Compile the launchid.c in a folder; return its call graph."""
    subprocess.run([compiler, "-std=c99", "-ffp-contract=off", "-fcallgraph-info=su", *flags, "-c", "launchid.c",
                    "-o", "stack.o"], cwd=folder, check=True, capture_output=True)
    (found,) = folder.glob("stack.ci")
    return Graph(found.read_text(encoding="utf-8"))
