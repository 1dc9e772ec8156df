"""A drive that is switched off runs down: friction over inertia, and both where a scale is known."""
