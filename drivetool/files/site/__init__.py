"""A site of recordings: its file, the manifest of what was done, the summary, the verdicts, the page."""
