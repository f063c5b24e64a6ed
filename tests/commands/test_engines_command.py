"""Engines: the list says what is installed, and `add` makes an environment whole."""

import json
from pathlib import Path
from typing import Any

import pytest

# Makes what the real one makes of `venv FOLDER` and of `pip install --python PYTHON WANTED`.
UV = """#!/bin/sh
if [ "$1" = venv ]; then
  mkdir -p "$5/bin" "$5/lib/python3/site-packages"; touch "$5/bin/python"; exit 0
fi
{then}
site="$(dirname "$(dirname "$5")")/lib/python3/site-packages/mujoco_warp-9.8.dist-info"
mkdir -p "$site"
printf 'Metadata-Version: 2.1\\nName: mujoco-warp\\nVersion: 9.8\\n' > "$site/METADATA"
"""


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    folder = tmp_path / "cache"
    monkeypatch.setenv("XDG_CACHE_HOME", str(folder))
    monkeypatch.setenv("PATH", str(tmp_path / "bin"), prepend=":")
    return folder / "contactlab"


def installer(folder: Path, then: str = "") -> None:
    """Put an installer of our own before any other."""
    uv = folder / "bin/uv"
    uv.parent.mkdir()
    uv.write_text(UV.replace("{then}", then))
    uv.chmod(0o755)


def versions(contactlab: Any) -> dict[str, str]:
    listed = json.loads(contactlab("list", "engines", "--format", "json").out)
    return {each["engine"]: each["version"] for each in listed}


def test_an_engine_is_added_once(contactlab: Any, cache: Path, tmp_path: Path) -> None:
    installer(tmp_path)
    assert versions(contactlab)["warp"] == "not installed"
    assert "contactlab parity --install NAME" in contactlab("list", "engines").err
    added = contactlab("parity", "--install", "warp")
    assert (added.code, added.out) == (0, "warp 9.8\n")
    assert added.err.startswith(f"setting up warp in {cache}/warp-")
    assert versions(contactlab)["warp"] == "9.8"
    (next(cache.glob("warp-*")) / "library.so").write_bytes(bytes(5_000_000))
    listed = json.loads(contactlab("list", "engines", "--format", "json").out)
    assert {each["size"] for each in listed if each["engine"] == "warp"} == {5}
    again = contactlab("parity", "--install", "warp")
    assert (again.code, again.out, again.err) == (0, "warp 9.8 is already installed\n", "")


def test_what_cannot_be_installed_leaves_nothing(
    contactlab: Any, cache: Path, tmp_path: Path
) -> None:
    installer(tmp_path, "echo no such wheel >&2; exit 1")
    failed = contactlab("parity", "--install", "warp")
    assert failed.code == 2
    assert "warp cannot be installed" in failed.err
    assert "no such wheel" in failed.err
    assert list(cache.iterdir()) == []


def test_what_is_no_engine_is_named(contactlab: Any, cache: Path) -> None:
    wrong = contactlab("parity", "--install", "wrap")
    assert wrong.code == 2
    assert "did you mean 'warp'?" in wrong.err
    assert "is now `contactlab parity --closed-forms`" in contactlab("engines", "panel").err
    here = contactlab("parity", "--install", "mujoco")
    assert (here.code, "is already installed" in here.out) == (0, True)
    assert not cache.exists()
