"""A grasp that succeeds only by sinking in, and the same grasp on pads that are solid.

    python examples/recorded_grasp.py

Both loops lift a block of 40 mm, and their own test, that the block is up, says success for both.
The records tell them apart: on soft pads the block is held by fingers that are inside of it.
"""

import mujoco

import contactlab

HAND = """
<mujoco>
  <option timestep="0.002" cone="elliptic" impratio="10"/>
  <default><default class="pad">
    <geom type="box" size=".02 .02 .02" friction="1" solref="{solref}" priority="1"/>
  </default></default>
  <worldbody>
    <geom name="floor" type="plane" size="1 1 .1"/>
    <body name="block" pos="0 0 .02"><freejoint/>
      <geom name="block" type="box" size=".02 .02 .02" mass=".1"/></body>
    <body name="hand" pos="0 0 .02"><joint name="lift" type="slide" axis="0 0 1"/>
      <inertial pos="0 0 0" mass="1" diaginertia=".01 .01 .01"/>
      <body name="left" pos="0 -.06 .01"><joint name="left" type="slide" axis="0 1 0"/>
        <geom name="left_pad" class="pad" mass=".1"/></body>
      <body name="right" pos="0 .06 .01"><joint name="right" type="slide" axis="0 -1 0"/>
        <geom name="right_pad" class="pad" mass=".1"/></body>
    </body>
  </worldbody>
  <actuator>
    <position name="lift" joint="lift" kp="2000" kv="100"/>
    <motor name="left" joint="left"/><motor name="right" joint="right"/>
  </actuator>
</mujoco>"""
PADS = {"solid": "0.004 1", "soft": "-400 -40"}
GRIP = 8.0  # N
LIFTED = 0.08  # m


def grasp(pads: str, store: str) -> None:
    """Close the hand, lift, and hold; record all of it."""
    model = mujoco.MjModel.from_xml_string(HAND.format(solref=PADS[pads]))
    data = mujoco.MjData(model)
    hold = {
        "subject": "block",
        "hold": {"from": 1.2, "relative_to": "hand"},
        "thresholds": {"exploited": 3e-3},  # m, by the guideline of grasps in a hand
    }
    with contactlab.record(
        model, data, store, monitor=["block"], scene=hold, fresh=True
    ) as recording:
        while data.time < 2.0:
            grip, up = min(data.time / 0.4, 1), min(max(data.time - 0.4, 0) / 0.6, 1)
            data.ctrl[:] = 0.15 * up, GRIP * grip, GRIP * grip
            recording.step()
        recording.reset(success=bool(data.body("block").xpos[2] > LIFTED))


def main() -> None:
    """Print what the loop says of each grasp, and what its record says."""
    print("pads   success   label        hold depth   hold slip   why")
    for pads in PADS:
        store = f"results/grasp_{pads}"
        grasp(pads, store)
        (record,) = contactlab.open(store).records()
        depth, slip = (record.metrics[name] or 0 for name in ("hold_penetration", "hold_slip"))
        print(
            f"{pads:6} {record.success!s:9} {record.label:12} {1e3 * depth:7.2f} mm "
            f"{1e3 * slip:8.2f} mm   {record.labels[0].reason}"
        )


if __name__ == "__main__":
    main()
