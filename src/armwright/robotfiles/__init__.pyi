"""The names of this room and where each lives: for type checkers, and for `armwright.lazy`."""

from armwright.description.servos import Servo as Servo, servos as servos
from armwright.description.writer import to_toml as to_toml, write_toml as write_toml
from armwright.parts.build import PartsBuild as PartsBuild
from armwright.robotfiles.check import Finding as Finding, Report as Report, check as check
from armwright.robotfiles.convert import Conversion as Conversion, convert as convert
from armwright.robotfiles.difference import Change as Change, Difference as Difference, diff as diff
from armwright.robotfiles.new import new_robot as new_robot
from armwright.robotfiles.write_parts import write_parts as write_parts
