"""HTML pages that need nothing else: one look, figures embedded, for a desk or a phone, by day or by night."""

import base64
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from ..rules import import_extra
from .style import Drawing


def render(template: Path, values: Mapping[str, Any], drawings: Sequence[Drawing]) -> str:
    """A page as HTML.

    **Arguments:**

    - `template`: the file; it extends base.html.jinja of this folder.
    - `values`: what the template speaks of.
    - `drawings`: the template's `picture(name)` shows them.
    """
    jinja2 = import_extra("jinja2", "app")
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader([template.parent, Path(__file__).parent]),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    figures = {drawing.name: _embedded(drawing) for drawing in drawings}
    return environment.get_template(template.name).render(**values, figures=figures)


def _embedded(drawing: Drawing) -> dict[str, str]:
    return {
        "title": drawing.title,
        "caption": drawing.caption,
        "data": base64.b64encode(drawing.png).decode("ascii"),
    }
