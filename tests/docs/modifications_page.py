"""docs/modifications.md, made of the catalogue by `python -m tests.docs.modifications_page`."""

from pathlib import Path

from contactlab.modifications.catalogue_page import modifications_page

PAGE = Path(__file__).parents[2] / "docs/modifications.md"

if __name__ == "__main__":
    PAGE.write_text(modifications_page(), encoding="utf-8")
