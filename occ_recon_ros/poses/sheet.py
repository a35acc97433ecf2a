"""A board as a PDF page in true size, with a scale bar to check the printer by."""

from .board import BoardSpec

PAPER_MM = {
    "a4": (210.0, 297.0),
    "a3": (297.0, 420.0),
    "a2": (420.0, 594.0),
    "a1": (594.0, 841.0),
    "a0": (841.0, 1189.0),
    "letter": (215.9, 279.4),
    "tabloid": (279.4, 431.8),
}
_POINTS_PER_MM = 72 / 25.4
_MARGIN_MM = 8.0  # what printers leave white
_FOOT_MM = 13.0  # for the scale bar and its words
_BAR_MM = 100.0


def sheet_pdf(board: BoardSpec, paper: str = "a4") -> bytes:
    """The page, as the bytes of a PDF file.

    Args:
        board: what to print, black on white.
        paper: one of PAPER_MM, upright or lying as the board needs it.

    Raises:
        ValueError: an unknown paper, or one that the board does not fit.
    """
    if paper not in PAPER_MM:
        raise ValueError(f"unknown paper '{paper}': use one of {', '.join(PAPER_MM)}")
    width, height = (1e3 * length for length in board.size_m)
    for page in (PAPER_MM[paper], PAPER_MM[paper][::-1]):
        if (
            width <= page[0] - 2 * _MARGIN_MM + 1e-9
            and height <= page[1] - _MARGIN_MM - _FOOT_MM + 1e-9
        ):
            return _pdf(page, _content(board, page))
    room = PAPER_MM[paper][0] - 2 * _MARGIN_MM, PAPER_MM[paper][1] - _MARGIN_MM - _FOOT_MM
    raise ValueError(
        f"the board is {width:g} mm x {height:g} mm, {paper} has room for {room[0]:g} mm x "
        f"{room[1]:g} mm: take fewer or smaller squares, or larger paper"
    )


def _content(board: BoardSpec, page: tuple[float, float]) -> str:
    """Drawing commands; the page is set up in millimetres, y up."""
    width, height = (1e3 * length for length in board.size_m)
    left = (page[0] - width) / 2
    top = page[1] - max(_MARGIN_MM, (page[1] - _FOOT_MM - height) / 2)
    lines = [f"{_POINTS_PER_MM:.9f} 0 0 {_POINTS_PER_MM:.9f} 0 0 cm", "0 g"]
    # One path, filled once: cells that touch must not show a hairline between them.
    for x0, y0, x1, y1 in 1e3 * board.black:
        lines.append(f"{left + x0:.5f} {top - y1:.5f} {x1 - x0:.5f} {y1 - y0:.5f} re")
    lines.append("f")
    bar_left, bar_y = (page[0] - _BAR_MM) / 2, 8.0
    lines.append("0.2 w")
    lines.append(f"{bar_left:.3f} {bar_y:.3f} m {bar_left + _BAR_MM:.3f} {bar_y:.3f} l")
    for tick in range(0, int(_BAR_MM) + 1, 10):
        long = 1.5 if tick % 50 == 0 else 0.8
        x = bar_left + tick
        lines.append(f"{x:.3f} {bar_y - long:.3f} m {x:.3f} {bar_y + long:.3f} l")
    lines.append("S")
    text = (
        f"{board.words}. Print at 100 % (no 'fit to page'): this bar must measure 100 mm. "
        "Glue it flat."
    )
    safe = text.replace("\\", "\\\\").replace("(", "\\(").replace(")", "\\)")
    text_left = max(_MARGIN_MM, page[0] / 2 - 0.45 * len(text))
    lines.append(f"BT /F1 2.1 Tf {text_left:.2f} {bar_y - 4.2:.2f} Td ({safe}) Tj ET")
    return "\n".join(lines)


def _pdf(page: tuple[float, float], content: str) -> bytes:
    """A PDF file of one page."""
    box = " ".join(f"{_POINTS_PER_MM * length:.4f}" for length in page)
    objects = [
        "<< /Type /Catalog /Pages 2 0 R /ViewerPreferences << /PrintScaling /None >> >>",
        "<< /Type /Pages /Kids [3 0 R] /Count 1 >>",
        f"<< /Type /Page /Parent 2 0 R /MediaBox [0 0 {box}] /Contents 4 0 R "
        "/Resources << /Font << /F1 5 0 R >> >> >>",
        f"<< /Length {len(content)} >>\nstream\n{content}\nendstream",
        "<< /Type /Font /Subtype /Type1 /BaseFont /Helvetica >>",
    ]
    out = b"%PDF-1.6\n"
    places = []
    for number, body in enumerate(objects, 1):
        places.append(len(out))
        out += f"{number} 0 obj\n{body}\nendobj\n".encode("ascii")
    table = "".join(f"{place:010d} 00000 n \n" for place in places)
    out += f"xref\n0 {len(objects) + 1}\n0000000000 65535 f \n{table}".encode("ascii")
    end = out.rindex(b"xref")
    out += (
        f"trailer\n<< /Size {len(objects) + 1} /Root 1 0 R >>\nstartxref\n{end}\n%%EOF\n".encode()
    )
    return out
