"""The bytes of a picture's file, refused before they are decoded where the picture would take more memory than any camera's does."""

from __future__ import annotations

import io
import warnings
from pathlib import Path

import numpy as np
import numpy.typing as npt

from urdfcal.base.errors import InputError
from urdfcal.base.reading import PICTURE, content_of
from urdfcal.vision.picture_header import is_too_short, stated_size

MOST_PIXELS = 150_000_000  # as many as the largest sensors have; decoded, with what is made of it, some 2 GB


def picture_content(path: str | Path) -> npt.NDArray[np.uint8]:
    """The bytes of a picture's file, (n,); whether they can be decoded is not known yet.

    Raises:
        InputError: it cannot be read, or its header states more than `MOST_PIXELS`, or than its bytes can hold.
    """
    content = content_of(path, PICTURE)
    width, height = _size_of(content)
    if width * height > MOST_PIXELS:
        raise InputError(f"is {width} x {height} px, expected at most {MOST_PIXELS // 1_000_000} Mpx; cut or scale it down", path)
    if is_too_short(content):
        raise InputError(f"is not readable as a picture: it has too few bytes for the {width} x {height} px that it states", path)
    return np.frombuffer(content, dtype=np.uint8)


def _size_of(content: bytes) -> tuple[int, int]:
    """Width and height that a picture's header states, [px]; zeros where it states none that can be understood."""
    known = stated_size(content)
    return known[1:] if known is not None else _size_of_rarer(content)


def _size_of_rarer(content: bytes) -> tuple[int, int]:
    """The same of TIFF and whatever else Pillow reads the header of."""
    from PIL import Image

    own_limit = Image.MAX_IMAGE_PIXELS
    try:
        Image.MAX_IMAGE_PIXELS = None  # ours is asked for above, in words of ours
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of odd metadata, which nothing here uses
            with Image.open(io.BytesIO(content)) as picture:
                return picture.size
    except Exception:  # what is no picture to this reader is one to OpenCV, or refused by it in a moment
        return 0, 0
    finally:
        Image.MAX_IMAGE_PIXELS = own_limit
