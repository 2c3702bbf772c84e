"""How figures look: what is written along their axes."""

import pytest

from whiskjax.show.style import Drawing, new_figure


@pytest.mark.parametrize(("low", "high", "said"), [(2.0, 1500.0, []), (2.0, 15.0, ["2×10⁰", "3×10⁰", "4×10⁰", "6×10⁰"])])
def test_labels_of_a_logarithmic_axis_have_room(low, high, said):
    """Over decades the powers of ten alone are named; within one the ticks between them are, as plain text."""
    figure = new_figure(3.0)
    axes = figure.subplots()
    axes.set_yscale("log")
    axes.set_ylim(low, high)
    assert Drawing("name", "title", "caption", figure).png
    minor = [label.get_text() for label in axes.yaxis.get_minorticklabels() if label.get_text()]
    assert minor == said if not said else minor[: len(said)] == said
    assert "10¹" in [label.get_text() for label in axes.yaxis.get_majorticklabels()]
