"""An arm or a controller in other programs' languages: C for microcontrollers, URDF, MJCF."""
