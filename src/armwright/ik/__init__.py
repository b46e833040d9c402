"""Inverse kinematics: joint positions that bring the tip, or another frame, to poses.

Units: joint positions and steps [rad | m]. An error counts as one length, e = √(distance² + (w angle)²) [m], with the weight
w [m/rad]; a tolerance holds for the distance [m] and for the angle [rad], each by itself. Of the damping λ |e|², λ is in 1/rad²
or 1/m².

Constants: most of those of the descent, its starts and its goals were chosen on arms of random axes, limits and sizes; none
belongs to a robot. Shares of a range, of the reach or of an error do not depend on an arm's size. Constants that are a length
or an angle separate rounding from a result or bound a step, for arms of some decimetres to some metres.
"""
