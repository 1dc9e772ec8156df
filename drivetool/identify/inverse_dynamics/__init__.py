"""The torque from the motion: inverse dynamics, by least squares or with instruments."""
