"""What connects wayfield with other systems: CoppeliaSim, ROS 2 and logs of real bases. Nothing below imports it."""
