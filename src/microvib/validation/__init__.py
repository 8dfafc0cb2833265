"""Published tests, which are data of the catalog, against what the scenarios give."""
