"""Envelopes: statistics of lines, spectra and densities over many runs or recordings, band by band."""
