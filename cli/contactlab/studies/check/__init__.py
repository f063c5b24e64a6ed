"""Checks of a model, by published guidelines, and what to change where it fails."""

from importlib import import_module
from pkgutil import iter_modules

from contactlab.registry import settle

# Each module may declare checks.
for _module in iter_modules(__path__):
    import_module(f"{__name__}.{_module.name}")
settle()
