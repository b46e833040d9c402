"""Variants of a description: with a payload, with locked joints, a part of it, with other values. Each is a description."""

from armwright.model.variants.locked import with_locked
from armwright.model.variants.payload import with_payload
from armwright.model.variants.subchain import Subchain, subchain
from armwright.model.variants.values import with_values

__all__ = ["Subchain", "subchain", "with_locked", "with_payload", "with_values"]
