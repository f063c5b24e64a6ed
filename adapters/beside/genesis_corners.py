"""Genesis' contacts in its own API: a keel, a mesh, and a capsule, whose ends are in the floor."""

import math

import genesis

KEEL = "-.1 0 0 .1 0 0 -.1 .05 .1 .1 .05 .1 -.1 -.05 .1 .1 -.05 .1"
BODY = f'<mujoco><asset><mesh name="keel" vertex="{KEEL}"/></asset><worldbody><body><freejoint/>'
genesis.init(backend=genesis.cpu, precision="64", logging_level="error")
scene = genesis.Scene(show_viewer=False)
scene.add_entity(genesis.morphs.Plane())
keel, capsule = (
    scene.add_entity(genesis.morphs.MJCF(file=f"{BODY}<geom {geom}/></body></worldbody></mujoco>"))
    for geom in ('type="mesh" mesh="keel"', 'type="capsule" size=".05" fromto="-.1 0 0 .1 0 0"')
)
scene.build()
for degrees in (0, 0.2, 0.5, 2):
    tilt = math.radians(degrees)
    for body, place, radius in ((keel, 0, 0), (capsule, 1, 0.05)):
        body.set_pos((0, place, radius - 0.002 - 0.1 * math.sin(tilt)))
        body.set_quat((math.cos(tilt / 2), 0, math.sin(tilt / 2), 0))
    scene.step()
    counts = [len(body.get_contacts()["penetration"]) for body in (keel, capsule)]
    print(f"{degrees:g} degrees: mesh {counts[0]}, capsule {counts[1]}")
