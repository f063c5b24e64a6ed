"""Rules of the style guide that a program can check, each with its advice.

A sentence rule looks at prose, a name rule at functions, classes and modules. `test_rules.py` has
sentences that each rule finds, and sentences that it must not find.
"""

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

from tests.prose.texts import FileContent, Name, Text


@dataclass(frozen=True)
class Finding:
    """A place that breaks a rule: the words that do, and their sentence."""

    rule: str
    line: int
    words: str
    text: str


# "What" as a noun: it stands for a thing that has no name in the sentence ("what fails", "what a
# task asks for"). Not found: questions, "what to do", "what if", and "what" before its noun.
_NOUNS_AFTER_WHAT = (
    "kinds? sorts? types? sizes? units? values? versions? order ways? extent degree share numbers? "
    "format formats times? parts? names? steps? rates? fractions? distance angle speed level"
).replace(" ", "|")
_WHAT = re.compile(
    r"(?<![\w-])what(?![\w'-])"
    rf"(?! (?:to (?!a\b|the\b|an\b|each\b|its\b)[a-z]|if\b|(?:{_NOUNS_AFTER_WHAT})\b))",
    re.IGNORECASE,
)

# A relative clause that starts with a preposition, or "whose". Not found: questions, and "which"
# that asks ("depends on which engine is used").
_WHICH = re.compile(
    r"(?<!depend )(?<!depends )(?<!depending )\b(?:"
    r"(?:of|by|in|for|at|on|from|to|with|through|under|above|below|beyond|after|before|over|within|"
    r"against|upon|without|than|between|near|into|during|behind|along|across|around|beneath|since|"
    r"until|about|via|per|among|outside|inside) (?:which|whom)|whose)\b",
    re.IGNORECASE,
)

# Literary or ambiguous words, each with the plain one.
_ODD_WORDS: dict[str, str] = {
    r"told|untold|tells? (?:apart|of)": "reported, said, given, distinguished",
    r"mend(?:s|ed|ing)?": "fix",
    r"beside": "besides, next to, as well as",
    r"nobody|somebody|everybody": "name the person, or use the passive",
    r"so (?:many|much)": "a number with its unit",
    r"so far (?:apart|away|off|from|beyond|below|above|into|less|more|that|out|up|down)": (
        "a distance with its unit"
    ),
    r"by (?:itself|themselves)|of (?:itself|themselves)": "alone, on its own",
    r"anew": "again",
    r"(?:is|are|was|were|has|have|had|needs?|takes?|makes?|says?|finds?|gives?|with) none": (
        "name the thing that is missing"
    ),
    # "There is no file" and "is no longer" are plain.
    r"(?<!there )(?<!There )(?:is|are|was|were) no "
    r"(?!longer\b|more\b|less\b|fewer\b|better\b|worse\b|larger\b|smaller\b|faster\b|slower\b|"
    r"higher\b|lower\b|greater\b|shorter\b|one\b)[a-z]+": "is not a ...",
    r"(?<!far )(?<!long )(?<!soon )as (?:it|they) (?:is|are|was|were|stands?)": ("unchanged"),
    r"(?:hangs?|hanging|hung) (?:on|upon)": "depends on",
    r"bears?|borne": "carries, holds, supports",
    # "Something else" is plain, and so is the keyword.
    r"(?<!thing )(?<!one )(?<!body )(?<!where )(?<!who )(?<!what )(?<!how )(?<!if/)(?<!if-)else": (
        "otherwise, or: another"
    ),
    r"but for": "except",
    r"nothing that": "no ...",
    r"thereof|therein|thereto|whereby|wherein|whereof|whither|hitherto|lest|whilst|amidst?|ere": (
        "a word of today"
    ),
    r"yardsticks?": "reference",
    r"phantom": "numerical error",
}
_ODD = re.compile(r"(?<![\w-])(?:" + "|".join(_ODD_WORDS) + r")(?![\w-])", re.IGNORECASE)

# A sentence that starts with its condition or its object. Not found: headings and questions.
_OPENING = re.compile(r"(?:Of|Where) (?!course\b)[a-z\d{'\"(_]|Nothing of\b")

ADVICE = {
    "what": "name the thing instead of 'what ...'",
    "which": "two sentences, or a plain subject, instead of 'of which' and 'whose'",
    "odd-word": "use the plain word",
    "opening": "subject first; a condition starts with 'If' or 'For'",
    "one-word-function": "name a function by a verb and its object",
    "private-docstring": "a private function needs none: a better name, or a comment that says why",
    "participle-name": "name the thing: result, input, report, not told, given, found",
}

# Past participles and function words that say nothing as the only word of a name.
_IRREGULAR = frozenset(
    """
    told kept found made taken given said begun met asked seen left lost held put done gone borne
    brought chosen drawn written known meant felt sent built caught cut driven shown shut spent
    stuck struck thrown worn bent broken fallen grown hidden led lent let paid risen torn sought
    of apart one own again there below beside away alike alone now lately such so
    """.split()  # noqa: SIM905
)
_ENDS_IN_ED = frozenset(
    """
    seed speed need feed shed bed red embed exceed proceed breed succeed indeed bleed weed sled deed
    reed
    """.split()  # noqa: SIM905
)


_INTERFACES = frozenset({"main", "act", "reset", "step", "close"})
"""Functions that others call by these names: the interfaces of environments and policies."""


def find_problems(content: FileContent, path: Path) -> list[Finding]:
    """Return the places in a file that break a rule, by line."""
    found = [finding for text in content.texts for finding in check_text(text)]
    if path.suffix == ".py":
        found += [finding for name in content.names for finding in check_name(name)]
    return sorted(found, key=lambda finding: (finding.line, finding.rule))


def check_text(text: Text) -> Iterator[Finding]:
    """Yield the places in prose that break a sentence rule."""
    for rule, pattern, applies in _SENTENCE_RULES:
        for match in pattern.finditer(text.flat):
            start, sentence = text.sentence_at(match.start())
            if applies(text, match, start, sentence):
                yield Finding(rule, text.line_at(match.start()), match.group(), sentence)


def check_name(name: Name) -> Iterator[Finding]:
    """Yield the rules that the name of a function, class or module breaks."""
    words = split_name(name.name)
    is_dunder = name.name.startswith("__") and name.name.endswith("__")
    if name.kind == "function" and not is_dunder:
        named = name.is_property or name.is_published or {*words} <= _INTERFACES
        if len(words) == 1 and not named:
            yield Finding("one-word-function", name.line, name.name, f"def {name.name}")
        if name.name.startswith("_") and name.has_docstring:
            yield Finding("private-docstring", name.line, name.name, f"def {name.name}")
    if len(words) == 1 and is_participle(words[0]) and not name.is_published:
        yield Finding("participle-name", name.line, name.name, f"{name.kind} {name.name}")


def split_name(name: str) -> list[str]:
    """Return the words of a snake_case or CamelCase name, in lower case."""
    return [word.lower() for word in re.findall(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+", name)]


def is_participle(word: str) -> bool:
    """Whether a word alone is a participle, or a word without a meaning of its own."""
    return word in _IRREGULAR or (word.endswith("ed") and len(word) > 3 and word not in _ENDS_IN_ED)


def advice_on(finding: Finding) -> str:
    """Return the advice of the broken rule, for an odd word the plain words."""
    if finding.rule == "odd-word":
        for pattern, plain in _ODD_WORDS.items():
            if re.search(rf"(?:{pattern})$", finding.words, re.IGNORECASE):
                return f"plain words: {plain}"
    return ADVICE[finding.rule]


_Applies = Callable[[Text, re.Match[str], int, str], bool]


def _is_statement(text: Text, match: re.Match[str], start: int, sentence: str) -> bool:
    del text, match, start
    return not sentence.rstrip("\"')*").endswith("?")


def _opens_statement(text: Text, match: re.Match[str], start: int, sentence: str) -> bool:
    opens = not text.flat[start : match.start()].strip(" #*->|(\"'\n")
    return opens and not text.is_heading and _is_statement(text, match, start, sentence)


def _always(text: Text, match: re.Match[str], start: int, sentence: str) -> bool:
    del text, match, start, sentence
    return True


_SENTENCE_RULES: tuple[tuple[str, re.Pattern[str], _Applies], ...] = (
    ("what", _WHAT, _is_statement),
    ("which", _WHICH, _is_statement),
    ("odd-word", _ODD, _always),
    ("opening", _OPENING, _opens_statement),
)
