"""The site: the pages of docs, a reference that is read from the code, a gallery of hard cases."""
