"""Numbers that steer the diagnosis stand in one room, each with its unit, meaning and reason."""

import ast
import re
from dataclasses import fields, is_dataclass
from importlib import import_module
from pathlib import Path

import pytest

import seod.diagnose

ROOT = Path(seod.diagnose.__file__).parent
STAGES = sorted(path.stem for path in (ROOT / "tuning").glob("[a-z]*.py"))
SEARCHING = ("record", "fitting", "starts", "search", "verdict", "account", "pipeline.py", "one_search.py")
NEITHER = {
    "NORM",
    "CORRELATED",
    "STATES",
    "MARKS",
    "_SQUARE_BEYOND",
    "_CHANGES",
    "_SPREAD",
    "_LARGEST",
    "_IMPOSSIBLE",
    "_SEED",
}
"""Constants of mathematics and of layouts: no judgement would change them."""
MATHEMATICS = {
    *(0.0, 0.5, 1.0, 2.0, 3.0, 4.0),
    12.0,  # variance of what is even between two steps
    100.0,  # percent
    1.4826,  # deviation over the median size, of what is normal
    0.455,  # median over mean, of its square
    37.0,  # deviations beyond which a chance is 0 in a double
    50.0,  # a logarithm beyond which an interval is as good as endless
}
"""Numbers within functions that steer nothing, but for those that only keep from dividing by 0, or finite."""
SAID = re.compile(r"^\[[^\]]+\] \S.*(Chosen|Measured|The contract's)", re.DOTALL)


def table(stage):
    """Class, its fields in the source, and what is said of each."""
    for node in ast.parse((ROOT / "tuning" / f"{stage}.py").read_text()).body:
        if isinstance(node, ast.ClassDef):
            said = {}
            for own, after in zip(node.body, [*node.body[1:], None], strict=True):
                if isinstance(own, ast.AnnAssign):
                    text = after.value.value if isinstance(after, ast.Expr) else ""
                    said[own.target.id] = text
            yield node.name, said


def instances(stage):
    """By name."""
    module = import_module(f"seod.diagnose.tuning.{stage}")
    return {
        name: value
        for name, value in vars(module).items()
        if is_dataclass(value) and not isinstance(value, type)
    }


@pytest.mark.parametrize("stage", STAGES)
def test_each_number_says_its_unit_its_meaning_and_why(stage):
    for name, said in table(stage):
        assert said, name
        for field, text in said.items():
            assert SAID.match(text), f"{stage}.{name}.{field}: {text!r}"


@pytest.mark.parametrize("stage", STAGES)
def test_numbers_cannot_be_changed_on_the_way(stage):
    module = import_module(f"seod.diagnose.tuning.{stage}")
    instances = [
        value for value in vars(module).values() if is_dataclass(value) and not isinstance(value, type)
    ]
    assert instances
    for each in instances:
        first = fields(each)[0].name
        with pytest.raises(AttributeError):
            setattr(each, first, 0)


def numeric(node):
    try:
        value = ast.literal_eval(node)
    except ValueError:
        return isinstance(node, ast.BinOp)
    values = value if isinstance(value, tuple) else (value,)
    return any(isinstance(each, int | float) and not isinstance(each, bool) for each in values)


def constants(path):
    """Numbers at the top of a module, by name."""
    for node in ast.parse(path.read_text()).body:
        if isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name) and numeric(node.value):
            yield node.target.id


def test_no_stage_keeps_a_number_of_its_own():
    files = searching()
    assert len(files) > 50
    assert {name for path in files for name in constants(path)} <= NEITHER


def within_functions(path):
    """Numbers within a module's functions that may steer it, with their place."""
    tree = ast.parse(path.read_text())
    for function in (node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)):
        told = [each for node in ast.walk(function) if progress(node) for each in ast.walk(node)]
        decided = [*function.args.defaults, *function.args.kw_defaults]
        for node in ast.walk(function):
            if isinstance(node, ast.Compare):
                decided += [node.left, *node.comparators]
            elif isinstance(node, ast.keyword):
                decided.append(node.value)
        for node in ast.walk(function):
            if not isinstance(node, ast.Constant) or node in told or type(node.value) not in {int, float}:
                continue
            if steers(node.value, decides=node in decided):
                yield f"{path.name}:{node.lineno}: {node.value}"


def steers(value, *, decides):
    """A decimal that is none of mathematics; a whole number that is compared, named, or a default."""
    if isinstance(value, float):
        return value not in MATHEMATICS and 1e-8 < value < 1e8
    return value > 2 and decides


def progress(node):
    """A call that tells how far the search is."""
    return isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "progress"


def searching():
    """Modules whose numbers stand in the tables."""
    return [
        path
        for room in SEARCHING
        for path in ([ROOT / room] if room.endswith(".py") else sorted((ROOT / room).rglob("*.py")))
    ]


def test_no_function_keeps_a_number_that_steers():
    assert [each for path in searching() for each in within_functions(path)] == []


@pytest.mark.parametrize(
    "text", ["damping = 1e-2", "near(2.5 * x)", "fit(x, most=20)", "if n < 50:\n        pass", "x = -0.65"]
)
def test_a_number_within_a_function_is_seen(text, tmp_path):
    path = tmp_path / "module.py"
    path.write_text(f"def asked(n, x):\n    {text}\n")
    assert list(within_functions(path))


def test_a_default_within_a_function_is_seen(tmp_path):
    path = tmp_path / "module.py"
    path.write_text("def asked(most=6):\n    return most\n")
    assert list(within_functions(path))


@pytest.mark.slow
def test_every_number_is_used():
    sources = "".join(
        path.read_text() for path in sorted(ROOT.rglob("*.py")) if path.parent != ROOT / "tuning"
    )
    for stage in STAGES:
        for instance, value in instances(stage).items():
            for field in fields(value):
                assert re.search(rf"\b{instance}\.{field.name}\b", sources), f"{instance}.{field.name}"
