"""The documents' linter finds what it should, and nothing else."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from seod.diagnose.search.budget import Budget
from seod.diagnose.tuning.record import BLOCKS
from seod.diagnose.tuning.search import BUDGET
from tests.scripts import loaded

REPO = Path(__file__).parents[2]
prose = loaded(REPO / "docs" / "prose.py")
MOST_LINES = 130
"""Of the page of the diagnosis: what is measured, and why, stands in its log and in the decisions."""


@pytest.mark.parametrize("rule", prose.RULES, ids=lambda rule: rule.instead)
def test_a_rule_finds_the_house_word_and_leaves_the_usual_one_alone(rule):
    assert re.search(rule.misused, rule.wrong)
    assert not re.search(rule.misused, rule.right)


def test_only_prose_counts():
    page = "\n".join(
        [
            "# A heading with play",
            "",
            "One sentence of `code with play` here, by Eq. 1. Another one.",
            "",
            "| play | in a table |",
            "",
            "```",
            "play in code",
            "```",
            "",
            "- an item",
            "  that goes on",
            "- [a link](play.md)",
        ]
    )
    found = prose.blocks(page)
    assert found[1:] == ["an item that goes on", "a link"]
    assert [prose.words(each) for each in prose.sentences(found[0])] == [8, 2]
    assert prose.misused(prose.Page("page.md", found)) == []
    assert prose.misused(prose.Page("page.md", ["The gear has play."]))[0].startswith(
        "page.md: 'play', better: backlash"
    )


def test_long_sentences_and_numbers_of_records_are_found():
    many = ["Word " * 40 + "."] * 2 + ["A short one."] * 10
    assert prose.length(prose.Page("page.md", many)) == 40
    assert prose.misused(prose.Page("page.md", ["As record 20817 shows."]))
    assert not prose.misused(prose.Page("docs/diagnosis-log.md", ["As record 20817 shows."]))


def test_the_page_of_the_diagnosis_is_short_and_has_no_number_of_a_record():
    page = (REPO / "docs" / "diagnosis.md").read_text()
    assert len(page.splitlines()) <= MOST_LINES
    assert re.findall(r"\b\d{5}\b", page) == []


def test_the_page_of_the_diagnosis_tells_the_work_of_a_search():
    page = (REPO / "docs" / "diagnosis.md").read_text()
    (told,) = re.findall(
        r"^\| `normal` \| (\d+) s of work .* from ([\d ]+) samples .* up to (\d+) s", page, re.M
    )
    work, rows, most = (float(each.replace(" ", "")) for each in told)
    assert rows == BLOCKS.searched_rows
    assert work == round(Budget.of(int(rows), "normal").total)
    assert most == BUDGET.search_s + BUDGET.further_s
    assert Budget.of(int(rows) - 1, "normal").total > Budget.of(int(rows), "normal").total


def test_arguments_of_a_docstring_are_paragraphs_of_their_own():
    lines = ["def f(a):", '    """Do it.', "", "    Args:", "        a: A number", "            of them."]
    source = "\n".join([*lines, "        b: Another.", '    """'])
    assert prose.docstrings(source) == ["Do it.", "A number of them.", "Another."]


def test_the_documents_are_plain(capsys):
    with pytest.raises(SystemExit) as ended:
        prose.main()
    told = capsys.readouterr()
    assert ended.value.code == 0, told.err
    assert " words  README.md\n" in told.out
