"""The pictures of the README and the docs, made by the commands of docs/pictures.toml.  `make pictures` calls this:

PYTHONPATH=tests python -m pictures.gallery [FILE …]      those files, or all; only what has changed is written
"""

from __future__ import annotations

import shlex
import shutil
import sys
import tempfile
import tomllib
from dataclasses import dataclass
from pathlib import Path

from docs.pages import run_here, write_files
from pictures.alike import OTHER_FONTS, SHARE, unlike
from pictures.browser import CHROMIUM, Browser
from pictures.paper import drawing_without_paper, without_paper

ROOT = Path(__file__).resolve().parents[2]
IMAGES = ROOT / "docs" / "images"
COLOURS = 96  # of a photograph of a page


@dataclass(frozen=True)
class Picture:
    """A row of docs/pictures.toml."""

    file: str
    commands: tuple[str, ...]
    page: str | None = None
    made: str | None = None
    opened: dict[str, object] | None = None

    @property
    def kept(self) -> Path:
        """The picture in the docs."""
        return IMAGES / self.file

    def make(self, folder: Path) -> Path:
        """Does the commands in a fresh folder; where the picture is then.

        Raises:
            AssertionError: a command that fails, with what it said.
        """
        shutil.copytree(ROOT / "examples", folder / "examples")
        if self.page is not None:
            write_files(self.page, folder)
        for command in self.commands:
            done = run_here(shlex.split(command), folder)
            assert done.returncode == 0, f"{command}: {done.stderr}"
        made = folder / (self.made or self.file)
        return made if self.opened is None else self._photographed(made, folder)

    def _photographed(self, page: Path, folder: Path) -> Path:
        from PIL import Image

        opened, path = self.opened or {}, folder / self.file
        browser = Browser(folder)
        try:
            browser.open(page, str(opened["at"]), (int(str(opened["width"])), int(str(opened["height"]))))
            seen = Image.fromarray(browser.picture().astype("uint8"))
        finally:
            browser.close()
        seen.quantize(COLOURS, dither=Image.Dither.NONE).save(path, optimize=True)
        return path

    def changed(self, made: Path) -> str | None:
        """Difference between the picture in the docs and a new one, in words; None: they are alike."""
        if not self.kept.exists():
            return "new"
        return unlike(self.finished(made), self.kept, SHARE if self.opened is None else OTHER_FONTS)

    def finished(self, made: Path) -> Path:
        """The picture as the docs keep it: without paper, but for the photograph of a page; a PNG with a palette."""
        from PIL import Image

        path = made.with_name(f"finished-{made.name}")
        if made.suffix == ".svg":
            path.write_text(drawing_without_paper(made.read_text(encoding="utf-8")), encoding="utf-8")
        elif self.opened is None:
            without_paper(made).quantize(256, Image.Quantize.FASTOCTREE, dither=Image.Dither.NONE).save(
                path, optimize=True
            )
        else:
            shutil.copyfile(made, path)
        return path


TABLE = tuple(
    Picture(**{**row, "commands": tuple(row["commands"])})
    for row in tomllib.loads((ROOT / "docs" / "pictures.toml").read_text(encoding="utf-8"))["picture"]
)


def main(names: list[str]) -> None:
    """Makes pictures anew."""
    for picture in [row for row in TABLE if not names or row.file in names]:
        if picture.opened is not None and CHROMIUM is None:
            print(f"{picture.file}: not made: it needs chromium")
            continue
        with tempfile.TemporaryDirectory() as folder:
            made = picture.make(Path(folder))
            difference = picture.changed(made)
            if difference is not None:
                shutil.copyfile(picture.finished(made), picture.kept)
            print(f"{picture.file}: {difference or 'as it was'}", flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
