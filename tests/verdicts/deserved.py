"""Flags of public models that plain MuJoCo bears out, each with the measurement that says so.

Depths are those of contacts at the start that the file says, before anything has moved; a geom that
is as deep as it is thick is inside the other. A flag that is not here is a false alarm.
"""

from fnmatch import fnmatchcase

_INSIDE = ("tunneling", "deep_penetration")
_ANY = ("*",)

# model, labels: why. Patterns as of a shell.
_DESERVED = {
    ("dm_control/*/drosophila_fused.xml", _ANY): "its labrum starts 140 mm inside its rostrum",
    ("dm_control/*/humanoid_CMU_V2019.xml", _ANY): "its femurs start 58 mm inside its root",
    ("dm_control/*/humanoid_CMU_V2020.xml", _ANY): (
        "its femurs start 87 mm inside its root, and leave at 145 rad/s in the first step"
    ),
    ("dm_control/mjcf/test_assets/robot_arm.xml", _ANY): "link 4 starts 61 mm inside the base",
    ("dm_control/mujoco/testing/assets/arm.xml", _ANY): "links 4 and 5 start 90 mm underground",
    ("dm_control/*/model_with_ball_joints.xml", _INSIDE): "two capsules start and stay crossed",
    ("dm_control/third_party/ant/ant.xml", _INSIDE): "legs of 160 mm start and stay coaxial",
    ("dm_control/*/jaco_arm.xml", _ANY): "ring 5 starts 151 mm inside link 2",
    ("gymnasium*/humanoidstandup.xml", _ANY): "its forearms start 36 mm underground, 31 mm thick",
    ("mujoco/testdata/model.xml", _ANY): "a capsule of 15 mm starts 28 mm inside a box",
    ("robosuite/*/fourier_*_hand.xml", _ANY): "the thumb starts and stays 15 mm inside the palm",
    ("robosuite/*/jaco_three_finger_gripper.xml", _ANY): (
        "the thumb starts 17 mm inside the palm, and fingers turn at up to 71,000 rad/s"
    ),
    ("robosuite/*/panda_gripper.xml", _ANY): "fingers start and stay 13 mm inside the hand",
    ("robosuite/*/rethink_gripper.xml", _ANY): "fingers start and stay 22 mm inside the base",
    ("robosuite/*/robotiq_gripper_140.xml", _ANY): "knuckles start and stay 29 mm inside the hand",
    ("robosuite/*/robotiq_gripper_s.xml", _ANY): "fingers start and stay 21 mm inside the palm",
    ("robosuite/*/jaco/robot.xml", _ANY): "the upper arm starts 81 mm inside the base",
    ("robosuite/*/tiago/robot.xml", _ANY): "the torso starts and stays 199 mm inside its column",
    ("robosuite/iiwa_with_gripper", _ANY): "fingers start 12 mm inside their knuckles",
    ("robosuite/jaco_with_gripper", _ANY): "the upper arm starts 81 mm inside the base",
    ("robosuite/kinova3_with_gripper", _ANY): "fingers start 12 mm inside their knuckles",
    ("robosuite/panda_with_gripper", _ANY): (
        "link 5 starts 42 mm inside the hand, with joint 4 outside its range"
    ),
    ("robosuite/tiago_with_gripper", _ANY): "the torso starts and stays 199 mm inside its column",
    ("robosuite/ur5e_with_gripper", _ANY): "fingers start and stay 21 mm inside the palm",
    ("robosuite/xarm7_with_gripper", _ANY): "the thumb starts and stays 20 mm inside the wrist",
    ("*/fetch/*.xml", ("constraint_violated",)): "the torso starts 39 mm below its range",
    ("dm_control/*/jaco_hand.xml", ("constraint_violated",)): (
        "its fingers start 0.15 rad outside their range"
    ),
    ("robosuite/*/spot_arm/robot.xml", ("constraint_violated",)): (
        "three tenths of its motor throw its wrist, without armature, 2.3 rad beyond its limit"
    ),
    ("robosuite/*/xarm7/robot.xml", ("constraint_violated",)): (
        "three tenths of its motor throw joint 7, without armature, 9.5 rad beyond its limit"
    ),
    ("robosuite/*/kinova3/robot.xml", ("energy_injection",)): (
        "its last joint, of 0.0007 kg m2, turns at 370 rad/s: by 0.7 rad in a step"
    ),
    ("robosuite/*/ur5e/robot.xml", ("tunneling",)): (
        "its last joint, of 0.0001 kg m2, turns at 1,360 rad/s: by 2.7 rad in a step"
    ),
    ("robosuite/*/floating_legged_base.xml", ("step_dependent", "chatter", "constraint_gain")): (
        "its yaw loop of 1,000 N m s on 0.18 kg m2 alternates from 59 to -4 rad/s once it moves"
    ),
    ("robosuite/*/omron_mobile_base.xml", ("constraint_violated",)): (
        "three tenths of its motor throw its torso, of 32 kg, 0.19 m beyond its range of 0.34 m"
    ),
    ("robosuite/*/gr1/robot.xml", ("constraint_violated",)): (
        "a tenth of its motor, of 20,000 N m on 0.0013 kg m2, turns its ankle by 34 rad too much"
    ),
    ("*/fetch/*.xml", ("squeezed",)): (
        "the base, which weighs 1,180 N and cannot rise, presses on the floor with 31,400 N for 2 s"
    ),
    ("*/point/point.xml", ("squeezed",)): (
        "the particle, which weighs 41 N and cannot rise, presses on the ground with 838 N for 2 s"
    ),
    # Their fixed base is of the world, so that contacts between it and the next body count.
    ("example-robot-data/alex/*.urdf", _ANY): "wrists start 46 mm inside the arms, 105 mm thick",
    ("example-robot-data/allegro_hand/*.urdf", _ANY): "the thumb starts 37 mm inside the palm",
    ("example-robot-data/bolt/bolt.urdf", _ANY): "its shoulders start 39 mm inside the trunk",
    ("example-robot-data/centauro/centauro.urdf", _ANY): "an arm starts 89 mm inside a hip",
    ("example-robot-data/double_pendulum/double_pendulum_simple.urdf", _ANY): (
        "its arm, 25 mm thick, starts and stays 12 mm inside its base, pressed by 1,077 N"
    ),
    ("example-robot-data/g1/g1_29dof_with_hand_rev_1_0.urdf", _ANY): (
        "undamped, it gains 0.22 J, and none at a quarter of its step; fingers get 23 mm deep"
    ),
    ("example-robot-data/iris/iris.urdf", _ANY): "rotors of 5 mm start 34 mm inside the base",
    ("example-robot-data/laikago/laikago.urdf", _ANY): "its hips start 60 mm inside the trunk",
    ("example-robot-data/panda/panda_collision.urdf", _ANY): "link 1 starts 120 mm inside link 0",
    ("example-robot-data/panda/panda.urdf", _ANY): "link 5 starts 41 mm inside link 7",
    ("example-robot-data/pr2/pr2.urdf", _ANY): "the torso starts 343 mm inside the base",
    ("example-robot-data/so_arm/*.urdf", _ANY): "the shoulder starts 28 mm inside the base",
    ("example-robot-data/solo/solo12.urdf", _ANY): "its shoulders start 44 mm inside the trunk",
    ("example-robot-data/talos_data/talos_left_arm.urdf", _ANY): "link 2 starts 66 mm in link 1",
    ("example-robot-data/talos_data/*.urdf", _ANY): "its hips start 93 mm inside its thighs",
    ("example-robot-data/tiago_pro/*.urdf", _ANY): "the torso starts 252 mm inside its column",
    ("example-robot-data/quadruped/quadruped.urdf", _ANY): (
        "its upper legs start and stay 25 mm inside the trunk"
    ),
    # The engine itself says so.
    ("*/fetch/*.xml", ("diverged",)): "bad accelerations: slides damped by 1e11 start in motion",
    ("robosuite/*/gr1/robot.xml", ("diverged",)): "bad accelerations, without damping",
}


def deserved(model: str, label: str) -> str | None:
    """Return why a flag is deserved, None if nobody has shown that it is."""
    for (pattern, labels), why in _DESERVED.items():
        if fnmatchcase(model, pattern) and any(fnmatchcase(label, each) for each in labels):
            return why
    return None
