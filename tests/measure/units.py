"""The same model in other units of length and mass, of which everything else follows."""

import xml.etree.ElementTree as ET

import mujoco
import numpy as np

# Powers of length and of mass of the numbers of an attribute; of joints those of a slide, then of
# what turns.
_LENGTHS = "1,0"
_PLAIN = {
    "size": _LENGTHS, "pos": _LENGTHS, "fromto": _LENGTHS, "margin": _LENGTHS, "gap": _LENGTHS,
    "anchor": _LENGTHS, "gravity": _LENGTHS, "ccd_tolerance": _LENGTHS, "offset": _LENGTHS,
    "mass": "0,1", "density": "-3,1", "viscosity": "-1,1", "diaginertia": "2,1",
    "friction": "0,0 1,0 1,0", "solimp": "0,0 0,0 1,0 0,0 0,0",
}  # fmt: skip
_OF_JOINTS = {
    "armature": ("0,1", "2,1"), "damping": ("0,1", "2,1"), "stiffness": ("0,1", "2,1"),
    "frictionloss": ("1,1", "2,1"), "range": (_LENGTHS, "0,0"), "margin": (_LENGTHS, "0,0"),
}  # fmt: skip
# What MuJoCo takes where nothing is written, in metres and kilograms.
_USUAL = {"friction": "1 0.005 0.0001", "solimp": "0.9 0.95 0.001 0.5 2", "density": "1000"}


def rescaled(text: str, length: float, mass: float) -> str:
    """Return a model in units of 1 / `length` m and 1 / `mass` kg; times are the same.

    It may have bodies with geoms, free, slide and hinge joints, `connect`, and keyframes.
    """
    model, root = mujoco.MjModel.from_xml_string(text), ET.fromstring(text)  # noqa: S314 Written here
    default = root.find("default")
    default = ET.SubElement(root, "default") if default is None else default
    geom = default.find("geom")
    geom = ET.SubElement(default, "geom") if geom is None else geom
    for name, usual in _USUAL.items():
        own = geom.get(name, "").split()
        geom.set(name, " ".join([*own, *usual.split()[len(own) :]]))
    if default.find("equality") is None:
        ET.SubElement(default, "equality", solimp=_USUAL["solimp"])
    option = root.find("option")
    option = ET.SubElement(root, "option") if option is None else option
    option.set("gravity", option.get("gravity", "0 0 -9.81"))
    option.set("ccd_tolerance", option.get("ccd_tolerance", "1e-6"))
    # It stops at what is gained of a cost that has a unit: below what would show.
    option.set("tolerance", "1e-15")
    for element in root.iter():
        turns = element.get("type", "hinge") != "slide"
        for name, value in element.attrib.items():
            powers = _PLAIN.get(name, "")
            if element.tag == "joint" and name in _OF_JOINTS:
                powers = _OF_JOINTS[name][turns]
            if powers:
                element.set(name, _scaled(value, powers, length, mass))
    ways = _ways(model, length)
    for key, places, speeds in zip(root.iter("key"), model.key_qpos, model.key_qvel, strict=True):
        key.set("qpos", " ".join(map(repr, (places * ways[0]).tolist())))
        key.set("qvel", " ".join(map(repr, (speeds * ways[1]).tolist())))
    return ET.tostring(root, encoding="unicode")


def _scaled(value: str, powers: str, length: float, mass: float) -> str:
    each = [[int(power) for power in one.split(",")] for one in powers.split()]
    numbers = [float(number) for number in value.split()]
    each = each * len(numbers) if len(each) == 1 else each
    scales = (length**long * mass**heavy for long, heavy in each)
    return " ".join(repr(number * scale) for number, scale in zip(numbers, scales, strict=False))


def _ways(model: mujoco.MjModel, length: float) -> tuple[np.ndarray, np.ndarray]:
    """Return (nq,) and (nv,) `length` where a coordinate is one, else 1."""
    places, speeds = np.ones(model.nq), np.ones(model.nv)
    for kind, place, dof in zip(model.jnt_type, model.jnt_qposadr, model.jnt_dofadr, strict=True):
        along = {mujoco.mjtJoint.mjJNT_FREE: 3, mujoco.mjtJoint.mjJNT_SLIDE: 1}.get(kind, 0)
        places[place : place + along] = speeds[dof : dof + along] = length
    return places, speeds
