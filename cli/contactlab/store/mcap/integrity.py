"""Whether a file's bytes are those that were written."""

import struct
import zlib

from mcap.opcode import Opcode
from mcap.writer import MCAP0_MAGIC

_FOOTER = struct.Struct("<BQQQI")
_DATA_END = struct.Struct("<BQI")
_SHORTEST = 2 * len(MCAP0_MAGIC) + _DATA_END.size + _FOOTER.size
_CRC_SIZE = 4


def damage(data: bytes) -> str | None:
    """Return what is wrong with a file's frame or checksums, in words; None if nothing is.

    The two checksums cover all bytes, so any flipped byte is found.
    """
    if len(data) < _SHORTEST or not data.startswith(MCAP0_MAGIC):
        return "this is no MCAP file"
    if not data.endswith(MCAP0_MAGIC):
        return "the file is cut short, or its end is damaged"
    end = len(data) - len(MCAP0_MAGIC)
    opcode, length, summary_start, _, summary_crc = _FOOTER.unpack_from(data, end - _FOOTER.size)
    if (opcode, length) != (Opcode.FOOTER, 20):
        return "the footer is damaged"
    if summary_start == 0:
        return "the summary is missing"
    return _data_damage(data, summary_start) or _summary_damage(
        data[summary_start : end - _CRC_SIZE], summary_crc
    )


def _data_damage(data: bytes, summary_start: int) -> str | None:
    data_end = summary_start - _DATA_END.size
    if not 0 <= data_end <= len(data) - _SHORTEST + len(MCAP0_MAGIC):
        return "the footer points outside the file"
    opcode, length, crc = _DATA_END.unpack_from(data, data_end)
    if (opcode, length) != (Opcode.DATA_END, _CRC_SIZE):
        return "the data section does not end right before the summary"
    if crc != zlib.crc32(memoryview(data)[:data_end]):
        return "the data section does not match its checksum"
    return None


def _summary_damage(summary: bytes, crc: int) -> str | None:
    return None if crc == zlib.crc32(summary) else "the summary does not match its checksum"
