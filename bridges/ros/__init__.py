"""Our worlds as a ROS 2 robot, and our policies as a node for a real one: `wayfield ros sim`, `drive` and `excite`.

Messages, conventions, watchdogs, guard, simulated body and command sequence are plain Python that needs no ROS; `nodes`
alone imports rclpy.
"""
