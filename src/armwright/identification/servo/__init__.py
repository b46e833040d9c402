"""Identification of servos on a bench: motor, friction by load and firmware from logs of goals and positions."""
