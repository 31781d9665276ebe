"""Sizes of pictures from their first bytes, beside what OpenCV reads of the whole."""

from __future__ import annotations

import struct
import zlib

import cv2
import numpy as np
import pytest

from urdfcal.vision.picture_header import is_too_short, stated_size

WIDTH, HEIGHT = 331, 177


def written(ending: str, *options: int) -> bytes:
    """A picture as OpenCV writes it."""
    picture = np.random.default_rng(0).integers(0, 255, (HEIGHT, WIDTH, 3), np.uint8)
    return cv2.imencode(ending, picture, options)[1].tobytes()


@pytest.mark.parametrize(
    ("kind", "content"),
    [
        ("PNG", written(".png")),
        ("JPEG", written(".jpg")),
        ("JPEG", written(".jpg", cv2.IMWRITE_JPEG_PROGRESSIVE, 1)),
        ("BMP", written(".bmp")),
        ("WebP", written(".webp", cv2.IMWRITE_WEBP_QUALITY, 80)),
        ("WebP", written(".webp", cv2.IMWRITE_WEBP_QUALITY, 101)),  # lossless
        ("GIF", b"GIF89a" + struct.pack("<HH", WIDTH, HEIGHT) + b"\0\0\0"),
        ("WebP", b"RIFF\0\0\0\0WEBPVP8X\x0a\0\0\0\0\0\0\0" + struct.pack("<I", WIDTH - 1)[:3] + struct.pack("<I", HEIGHT - 1)[:3]),
    ],
    ids=["png", "jpeg", "progressive", "bmp", "webp", "lossless", "gif", "extended"],
)
def test_the_size_is_that_of_the_picture(kind: str, content: bytes) -> None:
    """Of every kind that a browser shows, and of each prefix it is the same or unknown."""
    assert stated_size(content) == (kind, WIDTH, HEIGHT)
    assert {stated_size(content[:length]) for length in range(min(len(content), 700))} <= {None, (kind, WIDTH, HEIGHT)}


def test_a_comment_before_the_frame_is_passed_over() -> None:
    """JPEG allows any number of them."""
    content = written(".jpg")
    comment = b"\xff\xfe" + struct.pack(">H", 2002) + b"\xff\xc0" * 1000
    assert stated_size(content[:2] + comment + b"\xff" + content[2:]) == ("JPEG", WIDTH, HEIGHT)


def test_what_is_no_picture_has_no_size() -> None:
    """Neither text nor noise, nor a picture that ends early, of which nothing is decoded."""
    rng = np.random.default_rng(1)
    assert stated_size(b"-----BEGIN OPENSSH PRIVATE KEY-----") is None
    assert stated_size(b'<svg xmlns="http://www.w3.org/2000/svg"/>') is None
    for head in (b"", b"\xff\xd8\xff", b"\x89PNG\r\n\x1a\n", b"BM", b"RIFF\0\0\0\0WEBP"):
        for _ in range(50):
            stated_size(head + rng.bytes(int(rng.integers(0, 60))))


def test_a_huge_picture_is_known_from_its_header_alone() -> None:
    """20 000 x 20 000 pixels of one colour are 0.4 MB of PNG."""
    header = b"IHDR" + struct.pack(">IIBBBBB", 20_000, 20_000, 8, 0, 0, 0, 0)
    assert stated_size(b"\x89PNG\r\n\x1a\n" + struct.pack(">I", 13) + header + struct.pack(">I", zlib.crc32(header))) == (
        "PNG",
        20_000,
        20_000,
    )


def test_a_picture_that_cannot_hold_its_pixels_is_too_short() -> None:
    """A PNG of one colour, which packs best, is long enough; with a larger size in its header it is not."""
    content = cv2.imencode(".png", np.zeros((2000, 3000, 3), np.uint8), [cv2.IMWRITE_PNG_COMPRESSION, 9])[1].tobytes()
    assert not is_too_short(content)
    assert is_too_short(content[:16] + struct.pack(">II", 60000, 40000) + content[24:])
    assert not is_too_short(b"\xff\xd8\xff")
