"""Write docs/reference/modifications.md of the catalogue."""

from pathlib import Path

from contactlab.modifications.catalogue_page import modifications_page

PAGE = Path(__file__).parents[2] / "docs/reference/modifications.md"

if __name__ == "__main__":
    PAGE.write_text(modifications_page(), encoding="utf-8")
