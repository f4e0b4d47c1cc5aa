"""What connects wayfield with other systems: CoppeliaSim and ROS 2. The rooms below import nothing of it."""
