"""Every effect: what it is, how the engine leaves it out, what calls for it."""

from collections.abc import Mapping
from types import MappingProxyType

from contactlab.scene.effects.contacts import CONTACT
from contactlab.scene.effects.effect import Effect
from contactlab.scene.effects.entry import switch
from contactlab.scene.effects.motion import MOTION, RECORDING, SOLVING
from contactlab.scene.effects.unused import never
from contactlab.scene.engine_flags import FLAGS

_ALL = [*CONTACT, *SOLVING, *MOTION, *RECORDING]
_KNOWN = {each.name for each in _ALL}
_OTHER = [
    switch(name, "numerical", "engine switch", "whoever sets it", never)
    for name in FLAGS
    if name not in _KNOWN
]
_LACKING = {
    each.name for each in _ALL if each.switch.startswith("flag ") and each.name not in FLAGS
}
EFFECTS: Mapping[str, Effect] = MappingProxyType(
    {each.name: each for each in [*_ALL, *_OTHER] if each.name not in _LACKING}
)
# Decided before a model is compiled, and so not by writing into it.
COMPILED = ("sensor", "tendon", "energy")
