"""Nobody owns the name contactlab on PyPI, so nothing may install it from there."""

import re
import tomllib
from importlib.metadata import requires
from pathlib import Path

import pytest

from contactlab.errors import OutputError, install_command, optional

ROOT = Path(__file__).parents[2]
KINDS = {".md", ".yml", ".yaml", ".py", ".sh", ".toml", ".txt", ".html", ".j2", ".json", ".svg", ""}
FOLDERS = (
    ".ci",
    ".github",
    "adapters",
    "bench",
    "cli",
    "docs",
    "examples",
    "sweeps",
)
# A command that installs, up to the end of its line or of the code that it stands in.
INSTALLS = re.compile(
    r"(?:pip3? +(?:install|download|wheel)|uv +(?:add|tool +install|tool +run)|uvx"
    r"|pipx +(?:install|run)|conda +install|poetry +add)\b(?P<words>[^\n`|;&#]*)"
)
# The name itself, whatever follows it; but not as part of a path, nor before an address.
NAME = re.compile(r"(?<![\w./@-])contactlab(?![\w./-])(?!(?:\[[\w, -]*\])? *@)")
SPELLED = re.compile(r"(?<![\w./@-])contactlab(?:\[[a-z, ]+\])(?! *@)|contactlab *[=~<>]= *\d")
DEPENDS = re.compile(r"^dependencies *= *\[[^\]]*[\"']contactlab[^\]]*\]", re.MULTILINE)


def _texts() -> dict[str, str]:
    files = [*ROOT.glob("*.*"), ROOT / "Makefile"]
    files += [path for folder in FOLDERS for path in (ROOT / folder).rglob("*")]
    found = {}
    for path in files:
        skipped = {"node_modules", "__pycache__", "built"} & set(path.parts)
        if path.is_file() and path.suffix in KINDS and path.name != "CHANGELOG.md" and not skipped:
            found[str(path.relative_to(ROOT))] = path.read_text(encoding="utf-8", errors="ignore")
    return found


def _installs_the_name(text: str) -> list[str]:
    joined = re.sub(r"[\"'] *\n *f?[\"']", "", text.replace("\\\n", " "))  # strings in a row
    commands = [found for found in INSTALLS.finditer(joined) if NAME.search(found["words"])]
    return [found[0] for found in commands] + [
        found[0] for pattern in (SPELLED, DEPENDS) for found in pattern.finditer(joined)
    ]


@pytest.mark.parametrize(
    "text",
    [
        "- run: pip install contactlab",
        "pip install 'contactlab[view]'",
        "RUN pip install --no-cache-dir 'contactlab[ray,objects]'",
        "pip install --upgrade contactlab==0.3.0",
        "uv tool install contactlab",
        "uvx contactlab sweep",
        "pip install \\\n  contactlab",
        '"pip "\n    "install \'contactlab[gymnasium]\'"',
        "install cc or contactlab[fast]",
        "as `contactlab==0.3.0`",
        'dependencies = ["numpy", "contactlab"]',
    ],
)
def test_the_name_is_found_however_it_is_spelled(text: str) -> None:
    assert _installs_the_name(text)


@pytest.mark.parametrize(
    "text",
    [
        "pip install '.[view]'",
        "pip install ./contactlab",
        "pip install '/opt/contactlab[ray,objects]'",
        "pip install git+https://github.com/OWNER/contactlab@COMMIT",
        "pip install 'contactlab[ray] @ git+https://github.com/OWNER/contactlab@COMMIT'",
        "pip install mujoco; contactlab sweep bounce",
    ],
)
def test_a_checkout_or_an_address_is_not_the_name(text: str) -> None:
    assert not _installs_the_name(text)


@pytest.mark.long
def test_nothing_installs_the_name_from_an_index() -> None:
    texts = _texts()
    assert len(texts) > 500
    found = {
        name: commands for name, text in texts.items() if (commands := _installs_the_name(text))
    }
    assert found == {}


def test_the_project_asks_for_itself_nowhere() -> None:
    """An extra that names another one by `contactlab[...]` would."""
    assert not [each for each in requires("contactlab") or () if each.startswith("contactlab")]


PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]


@pytest.mark.parametrize("extra", PROJECT["optional-dependencies"])
def test_a_missing_extra_names_its_own_requirements(extra: str) -> None:
    wanted = "".join(f" '{each}'" for each in PROJECT["optional-dependencies"][extra])
    assert install_command(extra) == f"pip install{wanted}"
    with pytest.raises(OutputError) as caught, optional(extra, "this"):
        raise ImportError(name="part.of_it")
    assert str(caught.value) == f"this needs part, which is not installed; pip install{wanted}"


def test_extras_that_the_code_names_exist() -> None:
    called = re.compile(r"(?:optional|install_command)\(\s*['\"](\w+)['\"]")
    named = {each for text in _texts().values() for each in called.findall(text)}
    assert named <= set(PROJECT["optional-dependencies"])
    assert len(named) > 5
