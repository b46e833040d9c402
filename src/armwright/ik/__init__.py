"""Inverse kinematics: joint positions that bring the tip, or another frame, to poses."""
