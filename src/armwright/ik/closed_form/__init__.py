"""Closed-form inverse kinematics of six-joint arms, by subproblem decomposition. [EliasWen2025]"""
