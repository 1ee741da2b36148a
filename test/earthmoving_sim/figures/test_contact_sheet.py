"""The contact sheet lists all figures with captions and measured values."""

from earthmoving_sim.figures.contact_sheet import write_contact_sheet
from earthmoving_sim.figures.figure import Figure, FigurePicture


def test_figures_are_in_order_with_captions_and_values(tmp_path):
    figures = [
        Figure(number, f"Title {number}", "Text <b>", [FigurePicture(tmp_path / "a.jpg", "A & B")])
        for number in (22, 5)
    ]
    figures[0].measurements["particles"] = "12"
    page, text = (path.read_text() for path in write_contact_sheet(figures, tmp_path))
    assert text.index("Figure 5. Title 5") < text.index("Figure 22. Title 22")
    assert "![A & B](a.jpg)" in text
    assert "| particles | 12 |" in text
    assert '<img src="a.jpg" alt="A &amp; B">' in page
    assert "Text &lt;b&gt;" in page
