"""Many scenarios through one pipe: comparison with evidence, identification."""
