"""What is shipped: code, types, scenes, sweeps and schemas, and nothing else."""

import os
import shutil
import subprocess
import sys
import sysconfig
import tarfile
import zipfile
from pathlib import Path, PurePosixPath

import pytest

pytestmark = pytest.mark.night

ROOT = Path(__file__).parents[2]
IGNORED = {"__pycache__", "node_modules", "package-lock.json", ".venv", ".stubs", "results"}
DATA = ("adapters", "advisories", "models", "sweeps", "schemas")


def build(target: str, folder: Path) -> Path:
    hatchling = Path(sysconfig.get_path("scripts")) / "hatchling"
    subprocess.run(
        [hatchling, "build", "-t", target, "-d", folder], cwd=ROOT, check=True, capture_output=True
    )
    (built,) = folder.iterdir()
    return built


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return build("wheel", tmp_path_factory.mktemp("wheel"))


def sources(folder: str) -> set[PurePosixPath]:
    """Return the files below a folder of the checkout, but those that git ignores."""
    found = (path.relative_to(ROOT) for path in (ROOT / folder).rglob("*") if path.is_file())
    return {PurePosixPath(path) for path in found if not IGNORED & set(path.parts)}


def test_the_wheel_holds_code_and_data(wheel: Path) -> None:
    held = {PurePosixPath(name) for name in zipfile.ZipFile(wheel).namelist()}
    code = {path.relative_to("cli") for path in sources("cli")}
    data = {"contactlab" / PurePosixPath("_data") / path for name in DATA for path in sources(name)}
    assert PurePosixPath("contactlab/py.typed") in code
    assert len(data) > 10
    metadata = {path for path in held if path.parts[0].endswith(".dist-info")}
    assert held - metadata == code | data
    assert any(path.name == "LICENSE" for path in metadata)


def test_the_wheel_runs_from_anywhere(wheel: Path, tmp_path: Path) -> None:
    """Unpacked, and put before the checkout on the path."""
    shutil.unpack_archive(wheel, tmp_path / "site", "zip")
    run = (
        "import contactlab, sys; assert 'site' in contactlab.__file__; "
        "from contactlab.__main__ import main; main()"
    )
    for arguments in (["sweep", "bounce", "--limit", "3", "--workers", "0"], ["scenes"]):
        done = subprocess.run(
            [sys.executable, "-c", run, *arguments],
            cwd=tmp_path,
            env=os.environ | {"PYTHONPATH": str(tmp_path / "site")},
            capture_output=True,
            text=True,
            check=True,
        )
        assert "ball" in done.stdout or "3 runs, 3 traces" in done.stdout
    assert (tmp_path / "results/bounce/manifest.json").is_file()


def test_the_sdist_holds_what_builds_and_tests_it(tmp_path: Path) -> None:
    sdist = build("sdist", tmp_path / "sdist")
    with tarfile.open(sdist) as packed:
        names = {PurePosixPath(*PurePosixPath(name).parts[1:]) for name in packed.getnames()}
    for folder in ("cli", *DATA, "tests"):
        assert sources(folder) <= names
    assert {PurePosixPath("pyproject.toml"), PurePosixPath("LICENSE")} <= names
    assert not [path for path in names if IGNORED & set(path.parts)]
