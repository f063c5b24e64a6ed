"""The robots of wheels are found, one of each family, whatever else the wheels hold."""

from pathlib import Path

import pytest
from bench.atlas.wheels import families, wheels

MODEL = "<mujoco model='{}'><worldbody/></mujoco>"


def unpack(folder: Path, name: str, licence: str = "License: MIT", **files: str) -> Path:
    """Write a wheel as it is when unpacked; `a__b` is a file `a/b.xml`."""
    place = folder / name
    info = place / f"{name}-1.0.dist-info"
    info.mkdir(parents=True)
    (info / "METADATA").write_text(f"Name: {name}\nVersion: 1.0\n{licence}\n\nText\n")
    for key, text in files.items():
        file = place / f"{key.replace('__', '/')}.xml"
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text)
    return place


def names(folder: Path) -> set[tuple[str, ...]]:
    return {tuple(robot.name for robot in family) for family in families(folder)}


def test_near_equal_files_are_one_family(tmp_path: Path) -> None:
    texts = {name: MODEL.format(name) for name in ("ant", "ant_v5", "ant2", "hopper")}
    unpack(tmp_path, "gym", **{f"assets__{name}": text for name, text in texts.items()})
    ants = ("gym/assets/ant.xml", "gym/assets/ant2.xml", "gym/assets/ant_v5.xml")
    assert names(tmp_path) == {ants, ("gym/assets/hopper.xml",)}


def test_numbered_folders_are_one_family(tmp_path: Path) -> None:
    unpack(tmp_path, "blocks", **{f"objects__00{n}__00{n}": MODEL.format(n) for n in range(3)})
    assert [len(family) for family in families(tmp_path)] == [3]


def test_parts_and_files_that_are_no_models_are_left_out(tmp_path: Path) -> None:
    unpack(
        tmp_path,
        "suite",
        scene="<mujoco><include file='common/floor.xml'/></mujoco>",
        common__floor=MODEL.format("floor"),
        settings="<configuration/>",
    )
    assert names(tmp_path) == {("suite/scene.xml",)}


def test_a_file_that_two_wheels_carry_counts_once(tmp_path: Path) -> None:
    for wheel in ("first", "second"):
        unpack(tmp_path, wheel, ant=MODEL.format("ant"))
    assert names(tmp_path) == {("first/ant.xml",)}


def test_wheels_take_turns(tmp_path: Path) -> None:
    for wheel in ("first", "second"):
        unpack(tmp_path, wheel, **{name: MODEL.format(wheel + name) for name in ("ant", "bee")})
    assert [family[0].wheel.name for family in families(tmp_path)] == ["first", "second"] * 2


def test_licences_are_those_of_metadata(tmp_path: Path) -> None:
    unpack(tmp_path, "a", licence="License-Expression: Apache-2.0")
    unpack(tmp_path, "b", licence="Classifier: License :: OSI Approved :: MIT License")
    unpack(tmp_path, "c", licence="Summary: none")
    assert [wheel.licence for wheel in wheels(tmp_path)] == ["Apache-2.0", "MIT License", ""]


def test_an_empty_folder_is_told_what_belongs_there(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match="unzip each into a folder of its own"):
        wheels(tmp_path)
