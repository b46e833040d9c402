"""Gains of joint controllers by the rules of linear control, from the arm's linear model."""

from armwright.control.design.design_gains import GainDesign, design_gains
from armwright.control.design.state_space import state_space

__all__ = ["GainDesign", "design_gains", "state_space"]
