"""Files that are wrong, each in one way, by name: what people bring, and what is half there."""

BOX = '<geom name="box" type="box" size=".1 .1 .1"/>'
BODY = f'<body name="crate" pos="0 0 .1"><freejoint/>{BOX}</body>'
FLOOR = '<geom name="floor" type="plane" size="1 1 .1"/>'
KEY = '<keyframe><key name="home" qpos="0 0 .1 1 0 0 0"/></keyframe>'


def model(inside: str = FLOOR + BODY, beside: str = "") -> str:
    """Return an MJCF model of a world with something in it, and something beside."""
    return f"<mujoco>{beside}<worldbody>{inside}</worldbody></mujoco>\n"


def sweep(*lines: str, scene: str = "ball_drop") -> str:
    """Return a sweep file of a shipped scene, with lines of its own."""
    return "\n".join(("version: 1", f"scene: {scene}", "duration: 0.01", *lines)) + "\n"


MODELS = {
    "sound.xml": model(beside=KEY),
    "no-keyframe.xml": model(),
    "empty.xml": "",
    "nothing.xml": "<mujoco/>\n",
    "text.xml": "hello\n",
    "unclosed.xml": "<mujoco><worldbody>\n<geom size='1'>\n",
    "unknown-element.xml": model(FLOOR + "\n<gem type='box'/>"),
    "unknown-attribute.xml": model(FLOOR + "\n<geom tpye='box' size='1 1 1'/>"),
    "unknown-word.xml": model(FLOOR + "\n<geom type='bxo' size='1 1 1'/>"),
    "no-number.xml": model(FLOOR + "\n<geom type='box' size='1 one 1'/>"),
    "few-numbers.xml": model(FLOOR + "\n<geom type='box' size='1 1'/>"),
    "no-mass.xml": model(FLOOR + "\n<body name='ghost'><freejoint/></body>"),
    "no-mesh.xml": model(
        "<geom type='mesh' mesh='hand'/>", "<asset><mesh name='hand' file='hand.stl'/></asset>"
    ),
    "no-asset.xml": model("\n<geom type='mesh' mesh='hand'/>"),
    "no-include.xml": "<mujoco><include file='arm.xml'/></mujoco>\n",
    "own-include.xml": "<mujoco>\n<include file='own-include.xml'/></mujoco>\n",
    "own-model.xml": model("", "<asset><model name='own' file='own-model.xml'/></asset>"),
    "endless.xml": model(FLOOR + BODY, "<option gravity='0 0 -inf'/>"),
    "stepless.xml": model(FLOOR + BODY, "<option timestep='nan'/>"),
    "negative.xml": model(FLOOR + BODY, "<option impratio='-1'/>"),
    "outside.xml": model(FLOOR, "<asset><mesh name='hand' file='/etc/hostname'/></asset>"),
    "twice.xml": model(FLOOR + "\n" + FLOOR),
    "no-joint.xml": model(FLOOR + BODY, "<actuator><motor joint='knee'/></actuator>"),
    "static.xml": model(FLOOR + BOX),
    "html.xml": "<html><body>Sign in</body></html>\n",
    "robot.xacro": "<robot name='r' xmlns:xacro='http://ros.org/wiki/xacro'/>\n",
    "robot.urdf.xacro": "<robot name='r' xmlns:xacro='http://ros.org/wiki/xacro'/>\n",
    "in-disguise.urdf": "<robot name='r' xmlns:xacro='http://ros.org/wiki/xacro'>"
    "<xacro:macro name='m'/></robot>\n",
    "empty.urdf": "",
    "no-links.urdf": "<robot name='r'/>\n",
    "joint-type.urdf": "<robot name='r'><link name='a'/><link name='b'/><joint name='j' "
    "type='revolte'><parent link='a'/><child link='b'/></joint></robot>",
    "package.urdf": "<robot name='r'><link name='base'><collision><geometry>"
    "<mesh filename='package://arm/hand.stl'/></geometry></collision></link></robot>\n",
    "robot.usd": "PXR-USDC",
    "robot.usda": "#usda 1.0\n",
    "robot.sdf": "<sdf/>\n",
    "robot.mjb": "binary",
    "hand.obj": "v 0 0 0\n",
    "nothing-here/readme.txt": "no model\n",
}
SWEEPS = {
    "sound.yaml": sweep("axes: {timestep: [1.0e-3, 2.0e-3]}"),
    "empty.yaml": "",
    "comments.yaml": "# later\n",
    "list.yaml": "- timestep\n",
    "words.yaml": "timestep\n",
    "tabs.yaml": "version: 1\nscene: ball_drop\naxes:\n\ttimestep: [1e-3]\n",
    "unclosed.yaml": "version: 1\nscene: ball_drop\naxes: {timestep: [1e-3\n",
    "twice.yaml": sweep("duration: 2"),
    "binary.yaml": b"\x80\x81\xff",
    "no-version.yaml": "scene: ball_drop\n",
    "version-2.yaml": "version: 2\nscene: ball_drop\n",
    "no-scene.yaml": "version: 1\naxes: {timestep: [1.0e-3]}\n",
    "scene-typo.yaml": sweep(scene="ball_dorp"),
    "scene-xacro.yaml": sweep(scene="robot.xacro"),
    "scene-usd.yaml": sweep(scene="robot.usd"),
    "key-typo.yaml": sweep("axis: {timestep: [1.0e-3]}"),
    "axis-typo.yaml": sweep("axes: {timestp: [1.0e-3]}"),
    "axis-empty.yaml": sweep("axes: {timestep: []}"),
    "axis-word.yaml": sweep("axes: {timestep: [fast]}"),
    "axis-number.yaml": sweep("axes: {timestep: 1.0e-3}"),
    "axis-negative.yaml": sweep("axes: {timestep: [-1.0e-3]}"),
    "axis-choice.yaml": sweep("axes: {cone: [eliptic]}"),
    "axis-keyframe.yaml": sweep("axes: {keyframe: [home]}", scene="no-keyframe.xml"),
    "axis-unit.yaml": sweep("axes: {timestep: [1 kg]}"),
    "axis-short.yaml": sweep("axes: {solref: [0.02]}"),
    "axes-list.yaml": sweep("axes: [timestep]"),
    "range-zero.yaml": sweep("axes: {timestep: {range: [1.0e-3, 2.0e-3, 0]}}"),
    "log-negative.yaml": sweep("axes: {timestep: {logspace: [-1, 1, 3]}}"),
    "lin-two.yaml": sweep("axes: {timestep: {linspace: [1.0e-3, 2.0e-3]}}"),
    "form-typo.yaml": sweep("axes: {timestep: {linspce: [1.0e-3, 2.0e-3, 3]}}"),
    "uniform-alone.yaml": sweep("axes: {timestep: {uniform: [1.0e-3, 2.0e-3]}}"),
    "duration-unit.yaml": "version: 1\nscene: ball_drop\nduration: 2 lightyears\n",
    "duration-negative.yaml": "version: 1\nscene: ball_drop\nduration: -2\n",
    "no-oracle.yaml": sweep("tolerances: {oracle_error: 1%}", scene="pile"),
    "tolerance-typo.yaml": sweep("tolerances: {slip_distanc: 1mm}"),
    "tolerance-unit.yaml": sweep("tolerances: {penetration_max: 1 kg}"),
    "label-typo.yaml": sweep("expect: [{label: stabel}]"),
    "metric-typo.yaml": sweep("expect: [{metrics: {penetration: {max: 1}}}]"),
    "where-typo.yaml": sweep(
        "axes: {timestep: [1.0e-3]}", "expect: [{where: {timestp: 1.0e-3}, label: stable}]"
    ),
    "formula.yaml": sweep("axes: {timestep: [1.0e-3]}", "exclude: [{where: 'timestep >'}]"),
    "formula-name.yaml": sweep("axes: {timestep: [1.0e-3]}", "exclude: [{where: 'timestp > 1'}]"),
    "formula-call.yaml": sweep("axes: {timestep: [1.0e-3]}", "exclude: [{where: 'open(1) > 1'}]"),
    "all-excluded.yaml": sweep("axes: {timestep: [1.0e-3]}", "exclude: [{where: 'timestep > 0'}]"),
    "seeds.yaml": sweep("seeds: -1"),
    "trace.yaml": sweep("trace: some"),
    "sample.yaml": sweep("axes: {timestep: [1.0e-3]}", "sample: {method: sobl, n: 4}"),
    "include.yaml": sweep("axes: {timestep: [1.0e-3]}", "include: {file: rows.csv}"),
    "zip.yaml": sweep("zip: [{timestep: [1.0e-3, 2.0e-3], cone: [elliptic]}]"),
    "drive-typo.yaml": sweep("drive: exercis"),
    "drive-key.yaml": sweep("drive: {nosie: 0.3}"),
    "drive-file.yaml": sweep("drive: {file: controls.csv}"),
    "drive-policy.yaml": sweep("drive: {policy: 'policy.py:Policy'}"),
    "must.yaml": sweep("must: ['held(mugg)']", scene="grasp_mug"),
}
OTHERS = {
    "little-memory.xml": model(
        FLOOR
        + "".join(
            f"<body pos='{x} 0 .04'><freejoint/><geom type='box' size='.05 .05 .05'/></body>"
            for x in (0, 0.3)
        ),
        beside="<size memory='2K'/>",
    ),
    "broken.py": "def metric(:\n",
    "raises.py": "raise ValueError('no')\n",
    "policy.yaml": "tolerance: {}\n",
    "robot.txt": "hello\n",
    "folder.json/readme.txt": "a folder\n",
    "list-key/scene.yaml": "version: 1\nmodel: sound.xml\n? [[a]]\n: b\n",
}
FILES: dict[str, str | bytes] = {**MODELS, **SWEEPS, **OTHERS}
