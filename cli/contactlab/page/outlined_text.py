"""Text of SVG figures as outlines, which look alike with any fonts.

The renderer embeds in a PDF the glyphs that a picture needs. They are set side by side, without
kerning.
"""

import io
import re
import xml.etree.ElementTree as ET
from collections.abc import Sequence
from dataclasses import dataclass

import pikepdf
import vl_convert
from fontTools.pens.svgPathPen import SVGPathPen
from fontTools.pens.transformPen import TransformPen
from fontTools.ttLib import TTFont

_SVG = "http://www.w3.org/2000/svg"
_XLINK = "http://www.w3.org/1999/xlink"
_OF_TEXT = {"text-anchor", "font-family", "font-size", "font-weight", "font-style"}
_CODES = re.compile(r"<([0-9A-F]{4})> <([0-9A-F]{4,})>\n")


@dataclass(frozen=True)
class _Font:
    """A TrueType font, and the glyph of each character."""

    name: str
    outlines: TTFont
    glyphs: dict[str, str]

    @property
    def em(self) -> int:
        """Units of an em."""
        return vars(self.outlines["head"])["unitsPerEm"]

    def advance(self, character: str) -> float:
        """Return the distance from a character to the next one [em]."""
        advance, _ = self.outlines["hmtx"][self.glyphs[character]]
        return advance / self.em


def outline_text(svg: str) -> str:
    """Return an SVG picture with texts as paths, named by their words.

    A text stays unchanged if the renderer has no TrueType outlines of it.
    """
    # The fonts that the picture is drawn with, as far as they are TrueType.
    fonts: list[_Font] = []
    with pikepdf.open(io.BytesIO(vl_convert.svg_to_pdf(svg))) as opened:
        for font in opened.objects:
            if isinstance(font, pikepdf.Dictionary) and font.get("/Subtype") == "/Type0":
                described = font["/DescendantFonts"][0]["/FontDescriptor"]
                if "/FontFile2" in described:
                    outlines = TTFont(io.BytesIO(described["/FontFile2"].read_bytes()))
                    codes = _CODES.findall(font["/ToUnicode"].read_bytes().decode())
                    # Glyph 0 stands for the characters that the font lacks.
                    numbers = {
                        bytes.fromhex(text).decode("utf-16-be"): int(code, 16)
                        for code, text in codes
                    }
                    glyphs = {
                        text: outlines.getGlyphName(number)
                        for text, number in numbers.items()
                        if number
                    }
                    fonts.append(_Font(str(font["/BaseFont"]), outlines, glyphs))
    ET.register_namespace("", _SVG)
    ET.register_namespace("xlink", _XLINK)
    root = ET.fromstring(svg)  # noqa: S314 - drawn by this program
    for text in root.iter(f"{{{_SVG}}}text"):
        outline = _draw_text(text, fonts)
        if outline is None:
            continue
        plain_text = " ".join("".join(text.itertext()).split())
        for line in [*text]:
            text.remove(line)
        for name in _OF_TEXT.intersection(text.keys()):
            del text.attrib[name]
        text.tag, text.text = f"{{{_SVG}}}path", None
        text.attrib |= {"d": outline, "role": "img", "aria-label": plain_text}
    return ET.tostring(root, encoding="unicode")


def _draw_text(text: ET.Element, fonts: Sequence[_Font]) -> str | None:
    """Return the path of a text, line by line; None where a glyph is missing."""
    is_bold = text.get("font-weight") in {"bold", "600", "700", "800", "900"}
    ranked_fonts = sorted(fonts, key=lambda font: ("Bold" in font.name) != is_bold)
    size = float(text.get("font-size", "11px").removesuffix("px"))
    starts = {"start": 0.0, "middle": -0.5, "end": -1.0}
    anchor = starts[text.get("text-anchor", "start")]
    paths, down = list[str](), 0.0
    for line in [*text] or [text]:
        down += float(line.get("dy", 0)) if line is not text else 0.0
        characters = " ".join((line.text or "").split())
        chosen = [
            next((font for font in ranked_fonts if letter in font.glyphs), None)
            for letter in characters
        ]
        set_in = [font for font in chosen if font is not None]
        if len(set_in) < len(characters):
            return None
        # Each character is drawn in its font, on the baseline of the line.
        advances = [
            face.advance(character) for character, face in zip(characters, set_in, strict=True)
        ]
        pieces, right = list[str](), anchor * sum(advances)
        for character, face, advance in zip(characters, set_in, advances, strict=True):
            scale = size / face.em
            glyphs = face.outlines.getGlyphSet()
            pen = SVGPathPen(glyphs, "{:.2f}".format)
            glyphs[face.glyphs[character]].draw(
                TransformPen(pen, (scale, 0, 0, -scale, size * right, down))
            )
            pieces.append(pen.getCommands())
            right += advance
        paths.append("".join(pieces))
    return "".join(paths)
