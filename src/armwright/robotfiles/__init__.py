"""Robot files: compare two, check one, convert one to another format, start a new one."""

from armwright.robotfiles.check import Finding, Report, check
from armwright.robotfiles.convert import Conversion, convert
from armwright.robotfiles.difference import Change, Difference, diff
from armwright.robotfiles.new import new_robot

__all__ = ["Change", "Conversion", "Difference", "Finding", "Report", "check", "convert", "diff", "new_robot"]
