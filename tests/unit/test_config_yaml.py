"""YAML with places: what is a number, what is a mistake, and where."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import pytest
import yaml
from hypothesis import example, given, settings
from hypothesis import strategies as st

from seod.config.edit import edited
from seod.config.yaml_lines import MAX_DEPTH, Document, parse
from seod.files.shipped import configs_dir

if TYPE_CHECKING:
    from pathlib import Path


def only_problem(text: str) -> tuple[int, str]:
    problems = parse(text).problems
    assert len(problems) == 1, problems
    return problems[0].line, problems[0].message


PLAIN = {
    "1e-3": 1e-3, "8e6": 8e6, "5e-4": 5e-4, "1.": 1.0, ".5": 0.5, "-.5E+2": -50.0,
    ".inf": math.inf, "-.INF": -math.inf,
    "+7": 7, "010": 10, "0x101": 257, "0o17": 15, "true": True, "false": False, "~": None, "null": None,
}  # fmt: skip

TEXTS = ("yes", "no", "on", "off", "y", "12:30", "2024-01-01", "1_000", "0b11", "1e", "e5", "=", "'1e-3'")


def test_plain_words_follow_the_core_schema_of_yaml_1_2() -> None:
    document = parse("\n".join(f"k{i}: {text}" for i, text in enumerate(PLAIN)))
    found = dict(zip(PLAIN, document.value.values(), strict=True))
    assert found == PLAIN
    assert [type(value) for value in found.values()] == [type(value) for value in PLAIN.values()]


def test_what_only_yaml_1_1_converts_and_what_is_quoted_stays_text() -> None:
    document = parse("\n".join(f"k{i}: {text}" for i, text in enumerate(TEXTS)))
    assert list(document.value.values()) == [text.strip("'") for text in TEXTS]


@pytest.mark.parametrize("path", sorted(configs_dir().glob("*.yaml")), ids=lambda path: path.stem)
def test_readers_of_yaml_1_1_take_the_numbers_of_shipped_rigs_for_numbers(path: Path) -> None:
    assert yaml.safe_load(path.read_text()) == parse(path.read_text()).value


@pytest.mark.parametrize("value", [7e6, 1e-9, 1e16, 2.5e22, 0.1, -3.0])
def test_readers_of_yaml_1_1_take_numbers_that_are_written_for_numbers(value: float) -> None:
    text = edited((configs_dir() / "virtual.yaml").read_text(), {("axes", "motor", "K_L"): value})
    assert yaml.safe_load(text)["axes"]["motor"]["K_L"] == value
    assert parse(text).value["axes"]["motor"]["K_L"] == value


def test_nan_is_a_number() -> None:
    assert math.isnan(parse("x: .nan").value["x"])


def test_keys_are_text_whatever_they_look_like() -> None:
    assert parse("1: a\ntrue: b\n").value == {"1": "a", "true": "b"}


def test_places_are_those_of_the_keys() -> None:
    document = parse("a:\n  b: 1\n  c:\n    - 10\n    - d:\n        5\n")
    assert document.places["a",] == (1, 1)
    assert document.places["a", "b"] == (2, 3)
    assert document.places["a", "c"] == (3, 3)
    assert document.places["a", "c", 0] == (4, 7)
    assert document.places["a", "c", 1, "d"] == (5, 7)


def test_what_is_not_there_has_the_line_of_what_is_around_it() -> None:
    document = parse("x: 1\na:\n  b: 1\n")
    assert document.line(("a", "b", "c", 3)) == 3
    assert document.line(("a", "z")) == 2
    assert document.line(()) == 1


def test_duplicate_keys_are_told_with_both_lines_at_any_depth() -> None:
    document = parse("a:\n  b: 1\n  b: 2\nc: 3\na: 4\n")
    assert [(p.path, p.line) for p in document.problems] == [(("a", "b"), 3), (("a",), 5)]
    assert [p.message for p in document.problems] == [
        "duplicate key: it is already on line 2",
        "duplicate key: it is already on line 1",
    ]
    assert document.value == {"a": {"b": 1}, "c": 3}


@pytest.mark.parametrize(
    ("text", "line", "fragment"),
    [
        ("a: 1\nb: [1, 2\nc: 3\n", 2, "the [ is never closed"),
        ("a: 1\nb:\n\tc: 1\n", 3, "tab"),
        ("a: 1\nb: 'open\n", 2, "the quote ' is never closed"),
        ("a: 1\n---\nb: 1\n", 2, "document"),
        ("a: &x 1\nb: 2\n", 1, "anchors"),
        ("a: 1\nb: *x\n", 2, "aliases"),
        ("a: &x [*x]\n", 1, "anchors"),
        ("a: 1\nb: !!python/object:os.system {}\n", 2, "tags"),
        ("a: 1\nb: !!set {x}\n", 2, "tags"),
        ("a: 1\n? [1, 2]\n: 2\n", 2, "plain word"),
        ('a: 1\n"x\\ud800": 2\n', 2, "plain word"),
        ('a: 1\nb: "\\ud800"\n', 2, "cannot be read"),
        ("a: 1\nb: " + "9" * 5000, 2, "cannot be read"),
        ("a: 1\nb: \x00\n", 2, "U+0000"),
        ('a: 1\nb: "\\UFFFFFFFF"\n', 2, "not readable as YAML"),
        ("a: 1\nb: " + "[" * 100_000, 2, f"deeper than {MAX_DEPTH}"),
        ("a: 1\nb: " + "{a: " * 10_000, 2, f"deeper than {MAX_DEPTH}"),
    ],
)
def test_what_is_not_a_rig_files_yaml_is_told_with_its_line(text: str, line: int, fragment: str) -> None:
    found, message = only_problem(text)
    assert found == line
    assert fragment in message


PARSER_WORDS = ("while ", "expected", "scalar", "mapping", "token", "stream", "block", "flow", "node")
"""What nobody knows who has not written a parser."""


@pytest.mark.parametrize(
    ("text", "line", "message", "right"),
    [
        ('a: 1\nb: "open\nc: 2\nd: 3\n', 2, 'the quote " is never closed', 'a second "'),
        ('a: 1\nb: "open\nc: "x"\nd: 2\n', 2, "begins here ends only in line 3", "a second quote"),
        ('a: 1\n"b: 2\nc: 3\n', 2, 'the quote " is never closed', 'a second "'),
        ("a: 1\nb: [1, 2\nc: 3\nd: 4\n", 2, "the [ is never closed", "a ]"),
        ("a: 1\nb: {x: 1, y: 2\nc: 3\n", 2, "the { is never closed", "a }"),
        ("a: 1\nb: {x: 1\n", 2, "the { is never closed", "a }"),
        ("a: 1\nb: [1, 2}\nc: 2\n", 2, "the [ of line 2 is closed by }", "] instead"),
        ("a: 1\nb: ]\n", 2, "a ] without a [", "both, or none"),
        ("a: 1\nb: [", 2, "the [ is never closed", "a ]"),
        ("a: [1, {x: \n\n", 1, "the { is never closed", "a }"),
        ("a: [1, , 2]\n", 1, "',' where a value should stand", "a value"),
        ("a: {x: 1 y: 2}\nb: 1\n", 1, "a comma is missing", "{a: 1, b: 2}"),
        ("o: {a: 1,\n    b: 2 c: 3}\nd: 1\n", 2, "a comma is missing", "{a: 1, b: 2}"),
        ("a: 1\nrelay\n  e_a: 1\nc: 2\n", 2, "`relay` has no colon", "`relay:`"),
        ("axes:\n  motor:\n    relay\n      e_a: 1\n", 3, "`relay` has no colon", "`relay:`"),
        ("a: 1\n\n# more\nb 2\n\nc: 3\n", 4, "`b 2` has no colon", "`b: 2`"),
        ("a: 1\nb: 2\nc 3\n", 3, "`c 3` has no colon", "`c: 3`"),
        ("a: 1\nb:2\nc: 3\n", 2, "`b:2` has no blank after its colon", "`b: 2`"),
        ("a: 1\n\n  b: 2\nc: 3\n", 3, "`b: 2` is indented by 2 blanks, line 1 by 0", "as the keys beside it"),
        ("a:\n    b: 1\n  c: 2\n", 3, "`c: 2` is indented by 2 blanks, line 2 by 4", "as the keys beside it"),
        ("a: 1\nb: foo: bar\n", 2, "two keys in one line", '`b: "foo: bar"`'),
        ("a:\n  b: 1\n  - c\n", 3, "an entry of a list (-) among keys", "a key of its own"),
        ("a:\n  - 1\n  b: 2\n", 3, "among the entries of a list", "`- ` before each entry"),
        ("a: - 1\n", 1, "a list with - cannot begin in the line of its key", "[a, b]"),
        ("a: @x\n", 1, "a value cannot begin with @", "in quotes"),
        ("a: *\nb: 1\n", 1, "would be a reference", "in quotes"),
        ('a: "C:\\qq"\n', 1, "a backslash begins an escape", "single quotes"),
        ("a: 'x' y\nb: 1\n", 1, "text after the closing quote", "a # before a comment"),
        ("a: |x\n  b\n", 1, "after | or >", "in the lines below"),
        ("a: 1\n---\nb: 1\n", 2, "a second document", "without ---"),
        ("a: 1\n%x\n", 2, "`%x` stands where only a key can stand", "a key"),
        ("a: &x 1\nb: &x 2\n", 1, "anchors (&)", ""),
        ("a:\n\tb: 1\n", 2, "a tab", "blanks"),
    ],
)
def test_the_parsers_words_become_plain_ones_at_the_line_of_the_mistake(
    text: str, line: int, message: str, right: str
) -> None:
    (problem,) = parse(text).problems
    assert (problem.line, message in problem.message, right in problem.right) == (line, True, True), problem
    assert not [word for word in PARSER_WORDS if word in problem.message + problem.right]


def test_a_token_in_a_broken_line_is_not_repeated() -> None:
    for text in (
        "server:\n  read_token hushhush\n  port: 1\n",
        "server:\n  command_token:hushhush\n  port: 1\n",
    ):
        (problem,) = parse(text).problems
        assert problem.line == 2
        assert "hushhush" not in problem.message + problem.right


@pytest.mark.slow
@pytest.mark.parametrize("name", ["virtual.yaml", "can.yaml", "seat-can.yaml"])
def test_a_rig_file_with_one_character_less_is_told_near_it(name: str) -> None:
    """Each colon and bracket of a real file, taken out one at a time: told at its line or the next."""
    text = (configs_dir() / name).read_text()
    for at in [k for k, character in enumerate(text) if character in ":[]{}"]:
        broken = text[:at] + text[at + 1 :]
        line = text.count("\n", 0, at) + 1
        for problem in parse(broken).problems:
            assert abs(problem.line - line) <= 1, (line, text.splitlines()[line - 1], problem)
            assert "not readable" not in problem.message, problem


def test_a_merge_key_is_a_key_like_any_other() -> None:
    assert parse("a: {<<: {b: 1}}").value == {"a": {"<<": {"b": 1}}}


def test_an_empty_file_has_no_value() -> None:
    assert parse("# only a comment\n") == Document()


_fragments = st.one_of(
    st.sampled_from("a: \n[]{},|>'\\\t#?\x00\u00e9\u2028" + '"'),
    st.sampled_from(["- ", "&x", "*x", "!", "!!", "%YAML 1.2\n", "---", "<<", "1e3"]),
)


@pytest.mark.slow
@settings(deadline=None)
@given(st.one_of(st.text(max_size=60), st.lists(_fragments, max_size=25).map("".join)))
@example("%YAML 1." + "1" * 5000 + "\n--- a")
@example('"\\U00110000"')
@example("!<%FF> a")
@example("? ? ? ?")
def test_no_text_crashes_the_reader(text: str) -> None:
    document = parse(text)
    assert all(problem.line >= 1 for problem in document.problems)


_values = st.recursive(
    st.one_of(
        st.none(),
        st.booleans(),
        st.integers(),
        st.floats(allow_nan=False),
        st.text(st.characters(codec="ascii")),
    ),
    lambda inner: st.one_of(
        st.lists(inner, max_size=4),
        st.dictionaries(st.sampled_from("abcd"), inner, max_size=4),
    ),
    max_leaves=15,
)


@settings(max_examples=40, deadline=None)
@given(st.dictionaries(st.sampled_from("abcdef"), _values, max_size=5))
def test_what_pyyaml_writes_is_read_back(value: dict[str, object]) -> None:
    text = yaml.dump(value, Dumper=_PlainDumper)
    assert parse(text).value == value
    assert parse(text).problems == []


class _PlainDumper(yaml.SafeDumper):
    """Without anchors, and with texts quoted: pyyaml's idea of what needs quotes is that of YAML 1.1."""

    def ignore_aliases(self, data: object) -> bool:
        return True


_PlainDumper.add_representer(
    str, lambda dumper, text: dumper.represent_scalar("tag:yaml.org,2002:str", text, style='"')
)
