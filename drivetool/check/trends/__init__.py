"""Trends over the recordings of a site: means, drifts and change points of each parameter of each machine."""
