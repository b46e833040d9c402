"""An arm in other programs' languages: C for microcontrollers."""
