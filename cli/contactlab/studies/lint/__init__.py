"""Rules that a model's files are held against, compiled but not stepped: `contactlab lint`."""

from importlib import import_module
from pkgutil import iter_modules

from contactlab.registry import settle

# Each module may declare rules.
for _module in iter_modules(__path__):
    import_module(f"{__name__}.{_module.name}")
settle()
