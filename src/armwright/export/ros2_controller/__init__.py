"""The controller of a scenario as a package for ROS 2: a plugin of ros2_control around the exported C99."""
