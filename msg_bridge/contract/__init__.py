"""What soil and machines agree on; no ROS, no physics."""
