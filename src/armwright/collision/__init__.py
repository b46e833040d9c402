"""Distances of an arm's links from each other and from obstacles, by capsules."""

from armwright.collision.capsules import Capsule, link_capsules
from armwright.collision.clearance import Clearance, Nearest, clearance
from armwright.collision.obstacles import BoxObstacle, PlaneObstacle, SphereObstacle

__all__ = [
    "BoxObstacle",
    "Capsule",
    "Clearance",
    "Nearest",
    "PlaneObstacle",
    "SphereObstacle",
    "clearance",
    "link_capsules",
]
