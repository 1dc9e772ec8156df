"""Values out and back in: files, tables, pictures and pages.

Its wings go from bytes on disk over shapes and YAML to results, tables, figures and pages.
"""
