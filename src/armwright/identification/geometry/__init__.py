"""Kinematic calibration: corrections of an arm's geometry from measured points, poses and distances."""
