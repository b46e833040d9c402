"""Pictures without paper: drawn on white, they become ink on a transparent ground that suits white and black pages."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
from PIL import Image

DARKEST = 0.18  # luminance of the darkest ink: 4.5:1 on white paper, 4:1 on the dark pages of the docs and of GitHub
SHARES = np.array([0.2126, 0.7152, 0.0722])  # of red, green and blue in the luminance
STYLE = re.compile(r"(?P<what>fill|stroke): #(?P<hex>[0-9a-f]{6})\b")


def ink(colours: np.ndarray) -> np.ndarray:
    """Ink (…, 4) that looks like colours (…, 3), 0 to 1, on white paper, and is never darker than DARKEST.

    A colour c is α p + (1 − α), with p as saturated as it can be; where p is too dark it is lightened, and α grows.
    """
    cover = 1.0 - colours.min(axis=-1, keepdims=True)
    pure = 1.0 - (1.0 - colours) / np.maximum(cover, 1e-6)
    lift = np.zeros_like(cover)
    high = np.ones_like(cover)
    for _ in range(12):  # the share of white at which the luminance is DARKEST, by bisection
        middle = 0.5 * (lift + high)
        dark = _luminance(pure + middle * (1.0 - pure))[..., None] < DARKEST
        lift, high = np.where(dark, middle, lift), np.where(dark, high, middle)
    lift = np.where(_luminance(pure)[..., None] >= DARKEST, 0.0, high)
    return np.concatenate([pure + lift * (1.0 - pure), np.minimum(cover / (1.0 - lift), 1.0)], axis=-1)


def _luminance(colours: np.ndarray) -> np.ndarray:
    linear = np.where(colours <= 0.04045, colours / 12.92, ((colours + 0.055) / 1.055) ** 2.4)
    return linear @ SHARES


def without_paper(made: Path) -> Image.Image:
    """The picture on a transparent ground; as it is where it has one already."""
    image = Image.open(made)
    if has_transparent_ground(made):
        return image.convert("RGBA")
    colours, which = np.unique(np.asarray(image.convert("RGB")).reshape(-1, 3), axis=0, return_inverse=True)
    inks = np.rint(255 * ink(colours / 255)).astype("uint8")
    return Image.fromarray(inks[which.ravel()].reshape(image.height, image.width, 4))


def drawing_without_paper(text: str) -> str:
    """The same of an SVG by matplotlib."""

    def inked(found: re.Match[str]) -> str:
        *colour, cover = ink(np.array([int(found["hex"][k : k + 2], 16) for k in (0, 2, 4)]) / 255)
        opacity = "" if cover == 1.0 else f"; {found['what']}-opacity: {cover:.2f}"
        return f"{found['what']}: #" + "".join(f"{round(255 * value):02x}" for value in colour) + opacity

    return STYLE.sub(inked, text.replace("fill: #ffffff", "fill: none"))


def has_transparent_ground(picture: Path) -> bool:
    """True if most of the border is transparent; of an SVG, if no white is filled."""
    if picture.suffix == ".svg":
        return "fill: #ffffff" not in picture.read_text(encoding="utf-8")
    cover = np.asarray(Image.open(picture).convert("RGBA"))[..., 3]
    return bool(np.mean(np.concatenate([cover[0], cover[-1], cover[:, 0], cover[:, -1]]) == 0) > 0.5)


def on_white(picture: Path) -> np.ndarray:
    """Pixels (height, width, 3), 0 to 255, on white paper."""
    image = Image.open(picture).convert("RGBA")
    return np.asarray(Image.alpha_composite(Image.new("RGBA", image.size, "white"), image).convert("RGB")).astype(int)
