"""The places where a kernel's variables can be declared in C: at their first assignment, in the block that holds all
uses."""

import ast
from collections import deque
from collections.abc import Iterator

Block = tuple[int, ...]


def walk(tree: ast.AST) -> list[ast.AST]:
    """The nodes of `ast.walk`, statements in its order; those of an expression, which nobody changes, and of a function
    are collected once: who takes statements out of a function says so by `changed`."""
    known: list[ast.AST] | None = tree.__dict__.get("nodes")
    if known is not None:
        return known
    if isinstance(tree, ast.expr):
        known = tree.__dict__["nodes"] = list(ast.walk(tree))
        return known
    found, waiting = list[ast.AST](), deque([tree])
    while waiting:
        node = waiting.popleft()
        found.append(node)
        for child in ast.iter_child_nodes(node):
            if isinstance(child, ast.expr):
                found += walk(child)
            else:
                waiting.append(child)
    if isinstance(tree, ast.FunctionDef):
        tree.__dict__["nodes"] = found
    return found


def changed(tree: ast.FunctionDef) -> None:
    """Forget the nodes of a function whose statements are others now."""
    tree.__dict__.pop("nodes", None)


def _statements(body: list[ast.stmt], block: Block) -> Iterator[tuple[Block, ast.stmt]]:
    """Every statement with the blocks it is in, outermost first, in the order of the text."""
    for node in body:
        yield block, node
        for inner in ("body", "orelse"):
            yield from _statements(getattr(node, inner, []), (*block, id(getattr(node, inner, None))))


def _own_names(node: ast.stmt) -> Iterator[ast.Name]:
    """Names of a statement itself, not of the blocks in it."""
    for child in ast.iter_child_nodes(node):
        if isinstance(child, ast.expr):
            yield from (each for each in walk(child) if isinstance(each, ast.Name))


def _common(a: Block, b: Block) -> Block:
    shared = 0
    while shared < min(len(a), len(b)) and a[shared] == b[shared]:
        shared += 1
    return a[:shared]


def first_assignments(function: ast.FunctionDef) -> dict[int, set[str]]:
    """id of an assignment -> names that it may declare: it comes first, reads none of them, and all other uses are in
    its block."""
    home: dict[str, Block] = {}
    first: dict[str, tuple[Block, ast.stmt]] = {}
    for block, node in _statements(function.body, ()):
        inside = (*block, id(node.body)) if isinstance(node, ast.For) else block
        for name in _own_names(node):
            at = inside if isinstance(node, ast.For) and name is node.target else block
            home[name.id] = _common(home[name.id], at) if name.id in home else at
            first.setdefault(name.id, (at, node))
    found: dict[int, set[str]] = {}
    for variable, (block, node) in first.items():
        reads = {name.id for name in _own_names(node) if isinstance(name.ctx, ast.Load)}
        if isinstance(node, ast.Assign) and len(node.targets) == 1 and block == home[variable] \
                and variable not in reads:
            found.setdefault(id(node), set()).add(variable)
    return found
