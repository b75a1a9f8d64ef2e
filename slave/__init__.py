"""The slave daemon: safety gate, control loop, stage, gripper and load cell."""
