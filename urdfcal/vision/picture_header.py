"""How large a picture says that it is, read from the first bytes of its file, before memory for its pixels is taken."""

from __future__ import annotations

import struct

_JPEG_SIZES = frozenset(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}  # markers of frames; the three others are tables
_JPEG_ALONE = frozenset({0x01, *range(0xD0, 0xD9)})  # markers without a length

_PNG = b"\x89PNG\r\n\x1a\n"
_CHANNELS = {0: 1, 2: 3, 3: 1, 4: 2, 6: 4}  # by the colour type of a PNG
_DEFLATED = 1032  # bytes that one byte of deflate can stand for at most

KINDS = ("PNG", "JPEG", "GIF", "BMP", "WebP")


def stated_size(content: bytes) -> tuple[str, int, int] | None:
    """The kind of a picture, one of KINDS, and its width and height, [px]; None for what is none of these."""
    try:
        return _stated(content)
    except (struct.error, IndexError):  # it ends within its header
        return None


def is_too_short(content: bytes) -> bool:
    """Whether a PNG has too few bytes for the pixels that it states: then it is not whole, and decoding it takes memory for nothing."""
    if not content.startswith(_PNG) or len(content) < 26:
        return False
    width, height, depth, colour = struct.unpack_from(">IIBB", content, 16)
    return bool(width * height * depth * _CHANNELS.get(colour, 1) > 8 * _DEFLATED * len(content))


def _stated(content: bytes) -> tuple[str, int, int] | None:
    if content.startswith(_PNG) and content[12:16] == b"IHDR":
        return ("PNG", *struct.unpack_from(">II", content, 16))
    if content.startswith((b"GIF87a", b"GIF89a")):
        return ("GIF", *struct.unpack_from("<HH", content, 6))
    if content.startswith(b"BM"):
        old = content[14] == 12  # bytes of a header of OS/2
        width, height = struct.unpack_from("<HH" if old else "<ii", content, 18)
        return "BMP", abs(width), abs(height)  # a negative height counts from the top
    if content.startswith(b"RIFF") and content[8:12] == b"WEBP":
        return _webp(content)
    return _jpeg(content) if content.startswith(b"\xff\xd8\xff") else None


def _webp(content: bytes) -> tuple[str, int, int] | None:
    """The size of a lossy, a lossless or an extended file."""
    kind = content[12:16]
    if kind == b"VP8 ":
        width, height = struct.unpack_from("<HH", content, 26)
        return "WebP", width & 0x3FFF, height & 0x3FFF
    if kind == b"VP8L":
        (bits,) = struct.unpack_from("<I", content, 21)
        return "WebP", (bits & 0x3FFF) + 1, (bits >> 14 & 0x3FFF) + 1
    if kind == b"VP8X" and len(content) >= 30:
        return "WebP", 1 + int.from_bytes(content[24:27], "little"), 1 + int.from_bytes(content[27:30], "little")
    return None


def _jpeg(content: bytes) -> tuple[str, int, int] | None:
    """The size in the first frame, behind any number of tables and comments."""
    at = 2
    while content[at] == 0xFF:
        marker = content[at + 1]
        if marker in _JPEG_SIZES:
            height, width = struct.unpack_from(">HH", content, at + 5)
            return "JPEG", width, height
        if marker == 0xFF:  # a filling byte
            at += 1
        else:
            at += 2 if marker in _JPEG_ALONE else 2 + max(2, struct.unpack_from(">H", content, at + 2)[0])
    return None
