"""Effects of contact and of how contacts are found."""

from contactlab.scene.effects import turning, unused
from contactlab.scene.effects.effect import Effect
from contactlab.scene.effects.entry import friction, switch
from contactlab.scene.effects.unused import never

CONTACT = [
    switch(
        "contact",
        "physical",
        "normal force between bodies that touch",
        "geoms that can touch",
        unused.no_contact,
    ),
    friction(
        "tangential_friction",
        "force against sliding",
        "condim 1 at most",
        "contacts that may slide",
        unused.straight_drop,
    ),
    friction(
        "torsional_friction",
        "torque against spin about the normal",
        "condim 3 at most",
        "bodies that may spin in their contacts",
        unused.no_turning,
    ),
    friction(
        "rolling_friction",
        "torque against rolling",
        "condim 4 at most",
        "bodies that may roll",
        unused.no_turning,
    ),
    Effect(
        "elliptic",
        "numerical",
        "friction of one size in all directions, not a pyramid",
        "cone pyramidal",
        "contacts with friction",
        True,
        turning.is_elliptic,
        None,
        never,
        ("cone",),
    ),
    Effect(
        "noslip",
        "numerical",
        "a second solve against the creep of soft friction",
        "noslip_iterations 0",
        "friction that may creep",
        True,
        turning.option_is_set("noslip_iterations"),
        turning.turn_options_off("noslip_iterations"),
        unused.no_noslip,
        ("noslip_iterations",),
    ),
    Effect(
        "impratio",
        "numerical",
        "friction harder than the normal force",
        "impratio 1",
        "friction that may creep",
        True,
        turning.is_stiffer,
        turning.turn_impratio,
        unused.no_friction,
        ("impratio",),
    ),
    switch(
        "multiccd",
        "numerical",
        "several contacts between two convex shapes that meet in a face",
        "meshes, cylinders or other shapes of the general collision function",
        unused.no_general_collision,
    ),
    switch(
        "nativeccd",
        "numerical",
        "the engine's own general collision function",
        "meshes, cylinders or other shapes of the general collision function",
        unused.no_general_collision,
    ),
    switch(
        "speculative",
        "numerical",
        "contacts with what a body would pass in a step",
        "bodies that may move farther than their size in a step",
        unused.no_contact,
    ),
    switch(
        "midphase",
        "numerical",
        "sorting the geoms of a body before they are compared",
        "bodies of several geoms",
        unused.no_crowd,
        changes=False,
    ),
    switch(
        "filterparent",
        "physical",
        "no contact between a body and its parent",
        "geoms that can touch",
        unused.never,
    ),
]
