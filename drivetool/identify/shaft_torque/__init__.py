"""What a measured shaft torque tells: each side by itself, the gap by its dead stretches, the law of the gap."""
