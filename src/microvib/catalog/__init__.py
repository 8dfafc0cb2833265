"""Published scenarios and tables: data, no code."""
