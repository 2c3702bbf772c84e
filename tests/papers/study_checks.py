"""What holds for the page of every study."""

import html
import io
import re

import numpy as np
from PIL import Image as Picture


def text_of(page):
    """Text as a browser shows it."""
    return html.unescape(re.sub(r"\s+", " ", page))


def holds_all(page, summary, drawings, findings):
    """The page shows every drawing, none of them blank, says what is outside and tells every finding."""
    text = text_of(page)
    assert page.count("data:image/png;base64,") == len(drawings)
    for drawing in drawings:
        assert text_of(drawing.title) in text and text_of(drawing.caption) in text
        with Picture.open(io.BytesIO(drawing.png)) as picture:
            assert (np.asarray(picture.convert("L")) < 250).mean() > 0.005
    for name in summary["verdict"]["outside"]:
        assert f"Outside: {name}." in text
    assert summary["command"] in text
    for finding in findings:
        assert finding.title in text and text_of(finding.here) in text
