"""What people do with records of robots: compare two, check one, take one to another format."""

from armwright.record.check import Finding, Report, check
from armwright.record.convert import Conversion, convert
from armwright.record.difference import Change, Difference, diff

__all__ = ["Change", "Conversion", "Difference", "Finding", "Report", "check", "convert", "diff"]
