"""A cart with a pole that falls unless a policy moves the cart."""

_FLOOR = '<geom name="floor" type="plane" size="5 5 .1" pos="0 0 -1"/>'


def cart_pole(timestep: float, motor: str = "", more: str = "", floor: str = _FLOOR) -> str:
    """Return the MJCF of a cart-pole, with further attributes of its motor, and elements."""
    return f"""
<mujoco>
  <option timestep="{timestep}" integrator="implicitfast"/>
  <worldbody>
    {floor}
    <body name="cart">
      <joint name="rail" type="slide" axis="1 0 0"/><geom name="cart" size=".1" mass="1"/>
      <body name="pole">
        <joint name="hinge" axis="0 1 0"/>
        <geom name="pole" type="capsule" fromto="0 0 0 0 0 .6" size=".02" mass=".1"/>
      </body>
    </body>
  </worldbody>
  <actuator><motor name="push" joint="rail" ctrlrange="-50 50" {motor}/></actuator>
  {more}
</mujoco>
"""
