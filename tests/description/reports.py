"""The one check of an error's fields that the tables of refused files share."""

from __future__ import annotations

from armwright.errors import DescriptionError


def check_report(error: DescriptionError, place: str, words: str) -> None:
    """The place is exact; the words are one of the choices, or part of what is wrong or expected. A short line a problem."""
    assert error.place == place
    assert words in error.choices or words in f"{error.what}; {error.expected}"
    lines = str(error).splitlines()
    assert len(lines) == len(error.problems) + (len(error.problems) > 1)
    assert max(map(len, lines)) < 1500  # where nothing is near, all tags of a URDF are listed
    for noise in ("Input should", "Value error", "pydantic", "instance of", "function-", "tuple", "dictionary"):
        assert noise not in str(error)
