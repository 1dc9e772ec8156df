"""Files of a site of recordings."""
