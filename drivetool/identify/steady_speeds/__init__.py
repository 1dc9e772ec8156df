"""Intervals of constant speed or torque, and the friction that they tell."""
