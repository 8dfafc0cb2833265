"""Presentation: documents and their renderings, figures, and the report of each study."""
