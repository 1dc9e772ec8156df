"""Pages from the templates in the folder beside; the style is in the one that the others extend."""

from __future__ import annotations


def rendered(template: str, **values: object) -> str:
    """A page as text; every value is escaped but the pictures, SVG that the tool itself has drawn."""
    from jinja2 import Environment, PackageLoader, StrictUndefined

    environment = Environment(loader=PackageLoader("drivetool.files.pages"), autoescape=True, trim_blocks=True,
                              lstrip_blocks=True, keep_trailing_newline=True, undefined=StrictUndefined)
    return environment.get_template(template).render(values)
