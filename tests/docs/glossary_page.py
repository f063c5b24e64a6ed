"""docs/reference/glossary.md of the glossary; `python -m tests.docs.glossary_page` writes it."""

from pathlib import Path

from contactlab.studies.explain.glossary import glossary_page

PAGE = Path(__file__).parents[2] / "docs/reference/glossary.md"

if __name__ == "__main__":
    PAGE.write_text(glossary_page(), encoding="utf-8")
