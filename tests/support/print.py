"""What a PDF says."""

import io
import re


def pages(content: bytes, count: int | None = None) -> list[str]:
    """Texts of the first pages, or of all."""
    from pypdf import PdfReader

    first = PdfReader(io.BytesIO(content)).pages[:count]
    return [re.sub(r"\s+", " ", page.extract_text().replace("\u200b", "")) for page in first]
