"""`make ros`: a simulated cell, the bridge, and strangers at both of its wires."""

TOPICS = {
    "measured_js": "sensor_msgs/msg/JointState",
    "setpoint_js": "sensor_msgs/msg/JointState",
    "body/measured_cf": "geometry_msgs/msg/WrenchStamped",
    "body/predicted_cf": "geometry_msgs/msg/WrenchStamped",
}
"""What is counted, each at 200 Hz."""
CELL, AXIS, DOMAIN = "cell", "insertion", 61
