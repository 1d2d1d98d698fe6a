"""The rooms of the diagnosis, by walking the syntax trees: a log passes them in their order and comes back to none; no
imports in a circle anywhere; what is known of a cause stands in one place."""

import ast
import re
from collections.abc import Iterable
from pathlib import Path

import pytest
from every import every
from test_architecture import CORE, ROOT, SIM, imports, name_of, tree_of

import sim.diagnosis
from sim.diagnosis.causes import RECORDS
from sim.effects import CATALOGUE

DIAGNOSIS = ROOT / "sim" / "diagnosis"
ROOMS = ("data", "controller", "model", "causes", "search", "judge", "report")
FILES = sorted(DIAGNOSIS.rglob("*.py"))
MODULES = {".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__"): path
           for path in CORE + SIM}


def room_of(path: Path) -> str:
    """'' for what stands at the root: the package's words and the verdict."""
    inside = path.relative_to(DIAGNOSIS).parts
    return inside[0] if len(inside) > 1 else ""


def imported(path: Path) -> set[str]:
    """Modules of the house that a file imports, at any depth of it."""
    found = set()
    for module, names, _ in imports(path):
        found |= {each for each in (module, *(f"{module}.{name}" for name in names)) if each in MODULES}
    # `from package import module` needs the module; the package only for names of its own
    packages = {module for module, names, _ in imports(path) if module in MODULES and names
                and all(f"{module}.{name}" in MODULES for name in names)}
    return found - packages


def circles(graph: dict[str, set[str]]) -> list[str]:
    """The rest of a graph when what needs nothing else in it, or is needed by nothing, is taken away again and
    again."""
    graph = {name: (needs & set(graph)) - {name} for name, needs in graph.items()}
    while ends := [name for name, needs in graph.items()
                   if not needs or not any(name in others for others in graph.values())]:
        graph = {name: needs.difference(ends) for name, needs in graph.items() if name not in ends}
    return sorted(graph)


def test_every_file_of_the_diagnosis_is_in_a_room():
    assert {room_of(path) for path in FILES} == {"", *ROOMS}
    assert {path.name for path in FILES if not room_of(path)} == {"__init__.py", "verdict.py"}


def test_the_packages_words_draw_the_way_in_the_rooms_order():
    way = sim.diagnosis.__doc__[sim.diagnosis.__doc__.index("log ->"):]
    assert re.findall(r"-> (\w+):", " ".join(way.split())) == list(ROOMS)


@every("path", [path for path in FILES if room_of(path)], ids=name_of)
def test_a_room_imports_itself_and_those_before_it(path):
    before = ROOMS[:ROOMS.index(room_of(path)) + 1]
    for module in imported(path):
        if module.startswith("sim.diagnosis"):
            assert room_of(MODULES[module]) in before, f"{name_of(path)} imports {module}"


def test_the_verdict_says_nothing_itself():
    assert not any(module.startswith("sim.diagnosis.report") for module in imported(DIAGNOSIS / "verdict.py"))


def test_no_module_imports_itself_in_a_circle():
    """Functions that import count too."""
    found = circles({module: imported(path) for module, path in MODULES.items()})
    assert found == []


def test_a_circle_is_seen():
    assert circles({"a": {"b"}, "b": {"c"}, "c": {"a"}, "d": {"a"}, "e": set()}) == ["a", "b", "c"]
    assert circles({"a": {"b"}, "b": {"elsewhere"}}) == []


# ---- one visit


def calls_in(tree: ast.AST, name: str) -> int:
    return sum(isinstance(node, ast.Call) and ast.unparse(node.func) == name for node in ast.walk(tree))


@pytest.mark.parametrize("visit", ["stamps.stamp_faults", "channels.judged", "relations.relation_faults"])
def test_the_data_check_visits_stamps_channels_and_relations_once(visit):
    check = tree_of(DIAGNOSIS / "data" / "check.py")
    assert calls_in(check, visit) == 1
    module = visit.partition(".")[0]
    others = {ast.unparse(node.func) for node in ast.walk(check) if isinstance(node, ast.Call)
              and ast.unparse(node.func).startswith(f"{module}.")} - {visit}
    assert others <= {f"stamps.{name}" for name in ("usable_rows", "unit_fault", "origin_fault", "uniform_times")}


def test_a_log_is_checked_and_put_on_its_grid_once():
    """The second log, which is another one, is put on its grid once too."""
    body = tree_of(DIAGNOSIS / "verdict.py").body
    functions = {node.name: node for node in body if isinstance(node, ast.FunctionDef)}
    for name, where in (("check", "diagnose"), ("record", "diagnose"), ("with_commands", "_examined"),
                        ("select", "_searched")):
        assert calls_in(functions[where], name) == 1
        others = [other for other, function in functions.items() if calls_in(function, name) and other != where]
        assert others == (["_measure"] if name != "select" else []), name


# ---- one record per cause


def literals(tree: ast.Module) -> Iterable[str]:
    """Strings that are code: no docstrings."""
    words = {id(node.body[0].value) for node in ast.walk(tree)
             if isinstance(node, (ast.Module, ast.ClassDef, ast.FunctionDef)) and node.body
             and isinstance(node.body[0], ast.Expr)}
    return [node.value for node in ast.walk(tree)
            if isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in words]


def named_in(text: str) -> set[str]:
    """Causes that a string names: it is the name, or holds one that is no plain word."""
    return {cause for cause in CATALOGUE if text == cause or ("_" in cause and re.search(rf"\b{cause}\b", text))}


WORLD = DIAGNOSIS / "data" / "world.py"  # its states bear the names of the keys of [wind] and [offsets]


@every("path", [path for path in FILES if room_of(path) != "causes" and path != WORLD], ids=name_of)
def test_only_the_records_know_a_cause_by_its_name(path):
    assert [text for text in literals(tree_of(path)) if named_in(text)] == []


def test_the_walk_sees_a_name():
    tree = ast.parse('"""gust"""\ndef f(x):\n    """slosh"""\n    return x == "gust" or f"{x} actuator_gain: y"\n')
    assert [named_in(text) for text in literals(tree)] == [{"gust"}, {"actuator_gain"}]
    assert named_in("a gust of wind") == set()


def test_every_cause_of_the_catalogue_has_one_record():
    assert set(RECORDS) == set(CATALOGUE)
    written = sorted(ast.literal_eval(node.args[0]) for path in FILES if room_of(path) == "causes"
                     for node in ast.walk(tree_of(path))
                     if isinstance(node, ast.Call) and ast.unparse(node.func) == "Hypothesis")
    forms = {each.form.hypothesis.cause for each in RECORDS.values() if each.form is not None}
    assert written == sorted([*CATALOGUE, *forms])


@every("cause", CATALOGUE)
def test_a_record_and_its_effect_agree(cause):
    """Every free number and every word's brace is a parameter of the effect; limits are given at all the others."""
    record, parameters = RECORDS[cause], {each.name for each in CATALOGUE[cause].parameters}
    assert {free.name for free in record.free} <= parameters
    braces = set(re.findall(r"\{(\w+)\}", record.words))
    assert braces <= parameters and {record.free[0].name} <= braces
    if record.form is not None:
        form = record.form.hypothesis
        assert {record.form.parameter, *(free.name for free in form.free)} <= {
            each.name for each in CATALOGUE[form.cause].parameters}
    assert {other for other, _ in (*record.decides, *record.like)} <= set(CATALOGUE) - {cause}
