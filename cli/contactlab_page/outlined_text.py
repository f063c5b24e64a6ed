"""Text of SVG figures as outlines, which look alike whatever fonts their reader has.

The renderer embeds in a PDF the glyphs that a picture needs. They are read as the OpenType
specification says (tables head, hhea, hmtx, loca and glyf), and set side by side, without kerning.
"""

import io
import re
import struct
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from dataclasses import dataclass

import pikepdf
import vl_convert

_SVG = "http://www.w3.org/2000/svg"
_XLINK = "http://www.w3.org/1999/xlink"
_OF_TEXT = {"text-anchor", "font-family", "font-size", "font-weight", "font-style"}
_STARTS = {"start": 0.0, "middle": -0.5, "end": -1.0}
_CODES = re.compile(r"<([0-9A-F]{4})> <([0-9A-F]{4,})>\n")
# Flags of points, and of the parts of a glyph that is made of others.
_ON, _X_SHORT, _Y_SHORT, _REPEAT, _X_SAME, _Y_SAME = 1, 2, 4, 8, 16, 32
_WORDS, _SCALE, _MORE, _TWO_SCALES, _MATRIX = 1, 8, 32, 64, 128
_Point = tuple[float, float, bool]  # x, y, and whether the curve goes through it


@dataclass(frozen=True)
class _Font:
    """A TrueType font with the offsets of its tables, and the glyph of each character."""

    data: bytes
    tables: dict[bytes, int]
    glyphs: dict[str, int]

    def _read(self, table: bytes, form: str, offset: int) -> int:
        return struct.unpack_from(form, self.data, self.tables[table] + offset)[0]

    @property
    def em(self) -> int:
        """Units of an em."""
        return self._read(b"head", ">H", 18)

    def advance(self, glyph: int) -> int:
        """Return the distance to the next glyph [units]."""
        last = self._read(b"hhea", ">H", 34) - 1
        return self._read(b"hmtx", ">H", 4 * min(glyph, last))

    def _start(self, glyph: int) -> int:
        if self._read(b"head", ">h", 50):
            return self._read(b"loca", ">I", 4 * glyph)
        return 2 * self._read(b"loca", ">H", 2 * glyph)

    def contours(self, glyph: int) -> Iterator[list[_Point]]:
        """Yield the closed curves of a glyph [units]."""
        place = self._start(glyph)
        if place == self._start(glyph + 1):
            return
        count = self._read(b"glyf", ">h", place)
        place += self.tables[b"glyf"] + 10
        yield from self._simple(place, count) if count >= 0 else self._parts(place)

    def _simple(self, place: int, count: int) -> Iterator[list[_Point]]:
        ends = struct.unpack_from(f">{count}H", self.data, place)
        place += 2 * count
        place += 2 + struct.unpack_from(">H", self.data, place)[0]
        flags: list[int] = []
        while ends and len(flags) <= ends[-1]:
            flag, place = self.data[place], place + 1
            repeats = self.data[place] if flag & _REPEAT else 0
            place += bool(flag & _REPEAT)
            flags += [flag] * (1 + repeats)
        x, place = self._coordinates(place, flags, _X_SHORT, _X_SAME)
        y, place = self._coordinates(place, flags, _Y_SHORT, _Y_SAME)
        curve = [bool(flag & _ON) for flag in flags]
        points: list[_Point] = list(zip(x, y, curve, strict=True))
        for start, end in zip((0, *(each + 1 for each in ends)), ends, strict=False):
            yield points[start : end + 1]

    def _coordinates(
        self, place: int, flags: list[int], short: int, same: int
    ) -> tuple[list[int], int]:
        values: list[int] = []
        value = 0
        for flag in flags:
            if flag & short:
                value += self.data[place] if flag & same else -self.data[place]
                place += 1
            elif not flag & same:
                value += struct.unpack_from(">h", self.data, place)[0]
                place += 2
            values.append(value)
        return values, place

    def _parts(self, place: int) -> Iterator[list[_Point]]:
        flags = _MORE
        while flags & _MORE:
            flags, glyph = struct.unpack_from(">HH", self.data, place)
            form = ">hh" if flags & _WORDS else ">bb"
            right, up = struct.unpack_from(form, self.data, place + 4)
            place += 4 + struct.calcsize(form)
            sizes = {_SCALE: 1, _TWO_SCALES: 2, _MATRIX: 4}
            count = sum(size for each, size in sizes.items() if flags & each)
            given = [each / 2**14 for each in struct.unpack_from(f">{count}h", self.data, place)]
            place += 2 * count
            xx, xy, yx, yy = {
                0: (1.0, 0.0, 0.0, 1.0),
                1: (*given, 0.0, 0.0, *given),
                2: (*given[:1], 0.0, 0.0, *given[1:]),
                4: tuple(given),
            }[count]
            for contour in self.contours(glyph):
                yield [(xx * x + yx * y + right, xy * x + yy * y + up, on) for x, y, on in contour]


def outlined(svg: str) -> str:
    """Return an SVG picture whose texts are paths, named by what they say.

    A text of which the renderer has no TrueType outlines stays as it is.
    """
    fonts = _fonts(svg)
    ET.register_namespace("", _SVG)
    ET.register_namespace("xlink", _XLINK)
    root = ET.fromstring(svg)  # noqa: S314 - drawn by this program
    for text in root.iter(f"{{{_SVG}}}text"):
        drawn = _drawn(text, fonts)
        if drawn is None:
            continue
        said = " ".join("".join(text.itertext()).split())
        for each in [*text]:
            text.remove(each)
        for name in _OF_TEXT.intersection(text.keys()):
            del text.attrib[name]
        text.tag, text.text = f"{{{_SVG}}}path", None
        text.attrib |= {"d": drawn, "role": "img", "aria-label": said}
    return ET.tostring(root, encoding="unicode")


def _fonts(svg: str) -> list[tuple[str, _Font]]:
    """Return the name and the outlines of each font that a picture is drawn with."""
    found: list[tuple[str, _Font]] = []
    with pikepdf.open(io.BytesIO(vl_convert.svg_to_pdf(svg))) as opened:
        for font in opened.objects:
            if isinstance(font, pikepdf.Dictionary) and font.get("/Subtype") == "/Type0":
                described = font["/DescendantFonts"][0]["/FontDescriptor"]
                if "/FontFile2" in described:
                    data = described["/FontFile2"].read_bytes()
                    codes = _CODES.findall(font["/ToUnicode"].read_bytes().decode())
                    found.append((str(font["/BaseFont"]), _font(data, codes)))
    return found


def _font(data: bytes, codes: list[tuple[str, str]]) -> _Font:
    count = struct.unpack_from(">H", data, 4)[0]
    entries = struct.iter_unpack(">4s4xI4x", data[12 : 12 + 16 * count])
    glyphs = {bytes.fromhex(text).decode("utf-16-be"): int(code, 16) for code, text in codes}
    # Glyph 0 stands for what the font lacks.
    known = {character: glyph for character, glyph in glyphs.items() if glyph}
    return _Font(data, dict(entries), known)


def _drawn(text: ET.Element, fonts: list[tuple[str, _Font]]) -> str | None:
    """Return the path of a text, line by line; None where a glyph is missing."""
    is_bold = text.get("font-weight") in {"bold", "600", "700", "800", "900"}
    ranked = sorted(fonts, key=lambda each: ("Bold" in each[0]) != is_bold)
    size = float(text.get("font-size", "11px").removesuffix("px"))
    anchor = _STARTS[text.get("text-anchor", "start")]
    parts, down = [], 0.0
    for line in [*text] or [text]:
        down += float(line.get("dy", 0)) if line is not text else 0.0
        drawn = _line(" ".join((line.text or "").split()), [font for _, font in ranked])
        if drawn is None:
            return None
        glyphs, width = drawn
        parts += [
            _path([(size * (x + anchor * width), down - size * y, on) for x, y, on in contour])
            for contour in glyphs
            if contour
        ]
    return "".join(parts)


def _line(text: str, fonts: list[_Font]) -> tuple[list[list[_Point]], float] | None:
    """Return contours and width of a line [em], each character of the first font that has it."""
    contours: list[list[_Point]] = []
    width = 0.0
    for character in text:
        font = next((each for each in fonts if character in each.glyphs), None)
        if font is None:
            return None
        glyph = font.glyphs[character]
        contours += [
            [(width + x / font.em, y / font.em, on) for x, y, on in contour]
            for contour in font.contours(glyph)
        ]
        width += font.advance(glyph) / font.em
    return contours, width


def _path(points: list[_Point]) -> str:
    """Return a closed curve of quadratic arcs; between two controls it passes half-way."""
    whole: list[_Point] = []
    for one, other in zip(points, points[1:] + points[:1], strict=True):
        whole.append(one)
        if not (one[2] or other[2]):
            whole.append(((one[0] + other[0]) / 2, (one[1] + other[1]) / 2, True))
    first = next(place for place, each in enumerate(whole) if each[2])
    turned = [*whole[first + 1 :], *whole[: first + 1]]
    path = "M{:.2f} {:.2f}".format(*whole[first][:2])
    is_arc = False
    for x, y, on in turned:
        path += f"{'Q' if not on else ' ' if is_arc else 'L'}{x:.2f} {y:.2f}"
        is_arc = not on
    return f"{path}Z"
