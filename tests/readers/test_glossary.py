"""The glossary: every word that an answer names has an entry."""

import json
import re

import pytest
from noslip.analysis.text import WORDS
from noslip.cli.main import main
from noslip.readers.glossary import FILE, glossary, meanings


def test_entries_are_those_of_the_page():
    assert list(glossary()) == re.findall(r"^## (.*)$", FILE.read_text(), re.MULTILINE)
    assert all(len(meaning.split()) > 8 for meaning in glossary().values())


@pytest.mark.parametrize("word", WORDS)
def test_words_of_an_analysis_are_there(word):
    assert meanings(word)


def test_an_entry_is_found_by_parts_of_its_name(capsys):
    assert main(["glossary", "Zero", "dynamics", "--json"]) == 0
    assert json.loads(capsys.readouterr().out) == {"Zero dynamics": glossary()["Zero dynamics"]}
    assert list(meanings("constraint")) == [name for name in glossary() if "onstraint" in name]
    assert list(meanings("holonomic")) == ["Constraint, holonomic"]
    assert main(["glossary"]) == 0
    assert capsys.readouterr().out.splitlines() == list(glossary())


@pytest.mark.parametrize(
    "word, hint", [("involutve", "did you mean 'involutive'"), ("wombat", "it has Approach,"), ("", "has")]
)
def test_an_unknown_word_is_refused(capsys, word, hint):
    assert main(["glossary", word]) == 2
    said = capsys.readouterr().err
    assert hint in said and said.count("\n") == 1
