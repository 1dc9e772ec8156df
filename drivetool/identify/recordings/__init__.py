"""Several recordings of one machine: what differs between them, and how they scatter."""
