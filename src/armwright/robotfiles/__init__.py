"""Robot files: compare two, check one, convert one to another format."""

from armwright.robotfiles.check import Finding, Report, check
from armwright.robotfiles.convert import Conversion, convert
from armwright.robotfiles.difference import Change, Difference, diff

__all__ = ["Change", "Conversion", "Difference", "Finding", "Report", "check", "convert", "diff"]
