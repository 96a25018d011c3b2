"""Pictures with titles, and all of them on one sheet."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

U8 = NDArray[np.uint8]
BAR = 0.05
"""Height of the title, of the picture's width."""


def titled(picture: U8, title: str) -> Image.Image:
    """A picture below a bar with its title."""
    image = Image.fromarray(picture)
    bar = max(18, round(BAR * image.width))
    out = Image.new("RGB", (image.width, image.height + bar), "white")
    out.paste(image.convert("RGB"), (0, bar))
    font = ImageFont.load_default(round(0.62 * bar))
    ImageDraw.Draw(out).text((round(0.3 * bar), bar // 2), title, "black", font=font, anchor="lm")
    return out


def contact_sheet(rows: list[list[Image.Image]], width: int, path: Path) -> None:
    """Save pictures in rows and columns, each ``width`` pixels wide, as a PNG file."""
    height = round(width * rows[0][0].height / rows[0][0].width)
    columns = max(len(row) for row in rows)
    sheet = Image.new("RGB", (columns * (width + 6) + 6, len(rows) * (height + 6) + 6), "white")
    for i, row in enumerate(rows):
        for j, image in enumerate(row):
            small = image.resize((width, height), Image.Resampling.LANCZOS)
            sheet.paste(small, (6 + j * (width + 6), 6 + i * (height + 6)))
    sheet.save(path)
