"""Modal models from other people's finite elements."""

from microvib.io.nastran.reading import read_modal_model

__all__ = ["read_modal_model"]
