"""Experiments for identification: motions of an arm and commands of a motor, designed before anything is measured."""
