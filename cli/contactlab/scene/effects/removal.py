"""Leave effects out of a model before it is compiled."""

from collections.abc import Collection

import mujoco

from contactlab.scene.effects.effect import EffectRequest, ModelFacts
from contactlab.scene.recording_sensors import PREFIX


def left_uncompiled(facts: ModelFacts, request: EffectRequest) -> frozenset[str]:
    """Return the effects that a run's model is compiled without.

    Args:
        facts: of the whole model.
        request: what is asked of the run's effects.
    """
    asked, usual = request.asked, not request.auto
    out: set[str] = set()
    if facts.sensors and not asked.get("sensor", usual):
        out.add("sensor")
    read = facts.sensors and "sensor" not in out
    named = any(name.startswith("tendon_") for name in request.changed)
    spare = facts.tendons and facts.idle_tendons and not read and not named
    if spare and not asked.get("tendon", usual):
        out.add("tendon")
    if not asked.get("energy", True):
        out.add("energy")
    return frozenset(out)


def remove(spec: mujoco.MjSpec, without: Collection[str]) -> None:
    """Delete sensors and tendons from a model's specification, before its run's own are added."""
    for sensor in list(spec.sensors) if "sensor" in without else ():
        if not sensor.name.startswith(PREFIX) and sensor.type != mujoco.mjtSensor.mjSENS_PLUGIN:
            spec.delete(sensor)
    for tendon in list(spec.tendons) if "tendon" in without else ():
        spec.delete(tendon)
