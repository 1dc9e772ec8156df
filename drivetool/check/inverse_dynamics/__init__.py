"""Diagnosis where the motion is imposed: the torque that it asks for is the judge."""
