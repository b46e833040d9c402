"""`armwright identify`: parameters of motors and arms from logs."""

from __future__ import annotations

import typer

from armwright.cli.identify_arm import arm
from armwright.cli.identify_friction import friction
from armwright.cli.identify_gains import gains
from armwright.cli.identify_linear import linear
from armwright.cli.identify_motor import motor
from armwright.cli.identify_payload import payload
from armwright.cli.identify_servo import servo

identify = typer.Typer(name="identify", help="Identify parameters from logs of measurements.")
identify.command()(motor)
identify.command()(servo)
identify.command()(arm)
identify.command()(payload)
identify.command()(gains)
identify.command()(friction)
identify.command()(linear)
