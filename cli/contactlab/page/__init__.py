"""The page of a store and its figures, drawn by Altair; `contactlab report` finds them here."""
