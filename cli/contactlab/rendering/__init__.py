"""Reports as documents: numbers with units, a tree of blocks, and text, Markdown and HTML of it."""
