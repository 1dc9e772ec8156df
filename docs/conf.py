"""Sphinx reads the pages with this: Markdown by MyST, one theme, every dead reference a warning."""

project = "drivetool"
extensions = ["myst_parser", "sphinx.ext.mathjax"]
# Equations between dollar signs.
myst_enable_extensions = ["dollarmath"]
html_theme = "furo"
html_title = "drivetool"
html_show_copyright = False
html_copy_source = False
nitpicky = True
# Headings down to this level can be linked to: page.md#heading.
myst_heading_anchors = 3
# Two hyphens stay two hyphens: options begin with them.
smartquotes = False
