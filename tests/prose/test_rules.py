"""Each rule finds its sentences, and leaves plain English alone."""

from pathlib import Path

import pytest
from tests.prose.rules import ADVICE, advice_on, find_problems, is_participle, split_name
from tests.prose.texts import FileContent, read_markdown, read_python

FOUND = {
    "what": [
        "Return what reads a range.",
        "What fails there is reported.",
        "The command says what a task asks for.",
        "Its memory is the sum of what its\nbodies take.",
        "What is wrong? It prints what failed.",
    ],
    "which": [
        "The runs of which one failed are listed.",
        "The step by which it moves is small.",
        "A model whose step is long fails.",
        "Name the part in which\nthe force acts.",
    ],
    "odd-word": [
        "It is told twice.",
        "A smaller step mends it.",
        "Write the file beside the model.",
        "Nobody reads it.",
        "Draw so many runs.",
        "It moves by so much.",
        "The bodies stay so far apart.",
        "Each run starts by itself.",
        "The file is written anew.",
        "The reference is none of them.",
        "The run has none.",
        "This is no file.",
        "They are no numbers.",
        "Leave the model as it is.",
        "The result hangs on the step.",
        "The contact bears a load.",
        "The load is borne by the wall.",
        "Name a file, or else a folder.",
        "It holds but for the first step.",
        "It does nothing that a user sees.",
        "A step whereby it moves.",
    ],
    "opening": [
        "Of bodies that sleep, the larger counts.",
        "It stops. Where nothing meets the target, it fails.",
        "- Of each run one is drawn.\n- The next.",
        "Nothing of it is kept.",
    ],
}

LEFT_ALONE = [
    "What is wrong?",
    "Say which file is wrong, where, and what to write instead.",
    "It prints what kind of contact it is, and what size it has.",
    "The `what` of a record.",
    "Which engine is used depends on which package is installed.",
    "The engine, which is installed, is used.",
    "In which folder does it lie?",
    "There is no file, and it is no longer needed.",
    "Besides the model, the file has a task.",
    "Use something else, or anything else.",
    "The hopper has run so far without a failure.",
    "As far as it is known.",
    "Of course it runs.",
    "None of the runs failed.",
    "Where does it lie?",
    "## Where a change goes",
    "```\nwhat is told beside it\n```",
    "[the page](what-is-told.md) lies here.",
    "<!-- what is told -->",
    "| Where | of each |",
    "A hanging rope, a bearing and a beside-the-point name.",
]


@pytest.mark.parametrize(
    ("rule", "sentence"), [(rule, each) for rule, rows in FOUND.items() for each in rows]
)
def test_a_rule_finds_its_sentence_in_markdown_docstrings_comments_and_messages(
    rule: str, sentence: str
) -> None:
    words = " ".join(sentence.split()).replace("- ", "")
    sources = [f'"""{sentence}"""', f"# {words}", f"raise ValueError({words!r})"]
    contents = [FileContent(tuple(read_markdown(sentence)))]
    contents += [read_python(source, "module") for source in sources]
    for content in contents:
        assert [each.rule for each in find_problems(content, Path("a.py"))] == [rule]


@pytest.mark.parametrize("sentence", LEFT_ALONE)
def test_plain_english_and_code_are_left_alone(sentence: str) -> None:
    assert find_problems(FileContent(tuple(read_markdown(sentence))), Path("a.md")) == []


def test_code_in_docstrings_and_literals_without_words_are_no_prose() -> None:
    source = '"""See ``what is told``."""\nKEYS = {"what": 1, "told_apart": 2, "else": "#else"}'
    assert find_problems(read_python(source, "module"), Path("a.py")) == []


def test_a_number_sign_in_a_literal_starts_no_comment() -> None:
    found = find_problems(read_python('X = """\n# é told to us\n""" # told', "m"), Path("a.py"))
    assert [each.line for each in found] == [2, 3]


@pytest.mark.parametrize("sentence", FOUND["odd-word"])
def test_an_odd_word_has_its_plain_words(sentence: str) -> None:
    content = FileContent(tuple(read_markdown(sentence)))
    (finding,) = find_problems(content, Path("a.md"))
    assert advice_on(finding).startswith("plain words: ")


def test_a_sentence_is_printed_with_its_code() -> None:
    content = FileContent(tuple(read_markdown("The `tell` word\nis told. The next.")))
    (finding,) = find_problems(content, Path("a.md"))
    assert (finding.words, finding.text) == ("told", "The `tell` word is told.")


def test_a_message_with_values_is_one_sentence() -> None:
    source = 'raise ValueError(f"{path} is no file of {name}" " beside others")'
    found = find_problems(read_python(source, "module"), Path("a.py"))
    assert {each.text for each in found} == {"{} is no file of {} beside others"}
    assert [each.rule for each in found] == ["odd-word", "odd-word"]


def test_a_finding_has_its_line() -> None:
    source = '"""Read.\n\nA long text\nwithout what fails.\n"""\n\nX = 1  # told\n'
    found = find_problems(read_python(source, "module"), Path("a.py"))
    assert [(each.line, each.rule) for each in found] == [(4, "what"), (7, "odd-word")]
    markdown = "# Title\n\n```\ncode\n```\n\nSome text\n`code over\nlines` told.\n"
    rows = find_problems(FileContent(tuple(read_markdown(markdown))), Path("a.md"))
    assert [each.line for each in rows] == [9]


FUNCTIONS = """
class Told:
    def read(self): "Read."
    @property
    def step(self): ...
    @property
    def kept(self): ...
    def __len__(self): "Count."

def _fit_object(): "Fit."

@command
def sweep(): ...

def main(): ...

def fit_object(): "Fit."
"""


def test_names_of_functions_and_classes_follow_the_guide() -> None:
    found = find_problems(read_python(FUNCTIONS, "recorded"), Path("recorded.py"))
    assert [(each.rule, each.text) for each in found] == [
        ("participle-name", "module recorded"),
        ("participle-name", "class Told"),
        ("one-word-function", "def read"),
        ("participle-name", "function kept"),
        ("private-docstring", "def _fit_object"),
    ]


def test_names_split_into_words() -> None:
    assert split_name("_fit_object") == ["fit", "object"]
    assert split_name("MCAPReader") == ["mcap", "reader"]
    assert split_name("RunSpec2") == ["run", "spec"]


def test_nouns_that_end_like_participles_are_none() -> None:
    assert [is_participle(word) for word in ("recorded", "told", "seed", "speed", "red")] == [
        True,
        True,
        False,
        False,
        False,
    ]


def test_every_rule_has_advice_and_examples() -> None:
    names = {"one-word-function", "private-docstring", "participle-name"}
    assert set(ADVICE) == {*FOUND, *names}
