"""Export of an arm or a controller: C for microcontrollers, FMU, URDF, MJCF, ROS 2."""
