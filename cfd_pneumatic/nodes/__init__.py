"""The ROS shells: the only place that imports rclpy."""
