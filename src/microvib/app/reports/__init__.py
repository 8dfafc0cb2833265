"""Reports: a document as one tree of blocks, its two renderings, what all reports share, and the report of a run."""
