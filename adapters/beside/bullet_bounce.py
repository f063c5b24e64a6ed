"""Bullet's restitution in its own API: a ball of e = 0.6 that falls by 1 m, at four steps."""

import pybullet

for step in (0.0005, 0.001, 0.002, 0.004):
    pybullet.connect(pybullet.DIRECT)
    pybullet.setGravity(0, 0, -9.81)
    pybullet.setPhysicsEngineParameter(fixedTimeStep=step, restitutionVelocityThreshold=0.1)
    floor = pybullet.createMultiBody(0, pybullet.createCollisionShape(pybullet.GEOM_PLANE))
    sphere = pybullet.createCollisionShape(pybullet.GEOM_SPHERE, radius=0.05)
    ball, speeds = pybullet.createMultiBody(1, sphere, basePosition=[0, 0, 1.05]), [0.0]
    for body in (floor, ball):
        pybullet.changeDynamics(body, -1, restitution=0.6**0.5, linearDamping=0)
    while len(speeds) * step < 0.7:
        pybullet.stepSimulation()
        speeds.append(pybullet.getBaseVelocity(ball)[0][2])
    print(f"{1000 * step:g} ms: e = {max(speeds) / -min(speeds):.3f}")
    pybullet.disconnect()
