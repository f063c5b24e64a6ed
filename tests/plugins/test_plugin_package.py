"""A plug-in that is installed in an environment of its own, from the wheel that it is built as."""

import shutil
import subprocess
import sys
import sysconfig
from pathlib import Path

import pytest

from contactlab.store.finished_store import Store

pytestmark = pytest.mark.night

SOURCE = Path(__file__).parent / "springs"


@pytest.fixture(scope="module")
def environment(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An environment with the plug-in, which sees all that is installed here."""
    folder = tmp_path_factory.mktemp("environment")
    shutil.copytree(SOURCE, folder / "source")
    hatchling = Path(sysconfig.get_path("scripts")) / "hatchling"
    built = [hatchling, "build", "-t", "wheel", "-d", folder / "wheels"]
    subprocess.run(built, cwd=folder / "source", check=True, capture_output=True)
    (wheel,) = (folder / "wheels").iterdir()
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", folder / "venv"], check=True)
    python = folder / "venv/bin/python"
    (site,) = (folder / "venv/lib").glob("python*/site-packages")
    # The packages of this environment, and their .pth files.
    here = sysconfig.get_path("purelib")
    (site / "here.pth").write_text(f"import site; site.addsitedir({here!r})\n")
    install = ["install", "--quiet", "--no-deps", "--no-index", "--prefix", folder / "venv", wheel]
    subprocess.run([python, "-m", "pip", *install], check=True)
    return python


def contactlab(python: Path, *arguments: str, folder: Path) -> "subprocess.CompletedProcess[str]":
    main = "from contactlab.__main__ import main; main()"
    return subprocess.run(
        [python, "-c", main, *arguments],
        cwd=folder,
        capture_output=True,
        text=True,
        check=False,
    )


@pytest.mark.parametrize("workers", ["0", "2"])
def test_all_that_it_adds_is_in_the_store(environment: Path, folder: Path, workers: str) -> None:
    options = ("small.yaml", "-o", "store", "--workers", workers)
    done = contactlab(environment, "sweep", *options, folder=folder)
    assert done.returncode == 0, done.stderr
    records = list(Store.open(folder / "store").records())
    assert len(records) == 4
    assert {each.engine.name for each in records} == {"mujoco", "frozen"}
    for record in records:
        (plugin,) = record.plugins
        assert (plugin.name, plugin.version) == ("contactlab-springs", "1.2.0")
        assert record.metrics["hover_height"] == 0
        assert record.metrics["oracle_error"] == 0
        assert "hovering" in {entry.label for entry in record.labels}
    frozen = next(each.run_id for each in records if each.engine.name == "frozen")
    done = contactlab(environment, "verify", "store", frozen, folder=folder)
    assert "bitwise equal" in done.stdout, done.stderr
    # Without the plug-in the store can be read, and says what it was made with.
    here = Path(sys.executable)
    done = contactlab(here, "verify", "store", folder=folder)
    assert done.returncode == 0
    assert "was written with plug-ins that are not loaded: contactlab-springs 1.2.0" in done.stderr
    done = contactlab(here, "verify", "store", frozen, folder=folder)
    assert done.returncode == 2
    assert "plug-in contactlab-springs 1.2.0" in done.stderr
    done = contactlab(here, "report", "store", folder=folder)
    assert done.returncode == 0, done.stderr
