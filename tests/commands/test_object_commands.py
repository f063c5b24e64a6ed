"""Commands that write and read stores take addresses in object storage, and speak of them so."""

import json
from pathlib import Path
from typing import Any

import pytest

from contactlab.store.store_files import ObjectAddress, parse_address


@pytest.fixture
def at(bucket: str) -> str:
    return f"{bucket}/sweeps/one"


@pytest.fixture
def swept(contactlab: Any, small: Path, at: str) -> str:
    """A store in the bucket; the same sweep's is in the folder `local`. Return its first run."""
    for target in (at, "local"):
        assert contactlab("sweep", str(small), "--workers", "0", "-o", target).code == 0
    shown = contactlab("show", at)
    return shown.out.partition("look closer: ")[2].split()[3]


@pytest.mark.long
def test_readers(contactlab: Any, swept: str, at: str) -> None:
    for arguments, expected in {
        ("show", at): f"4 runs, 4 traces in {at}",
        ("show", at, swept): f"contactlab verify {at} {swept}",
        ("verify", at): f"{at} is sound: 4 runs, 4 traces",
        ("verify", at, swept): "bitwise equal",
        ("compare", "local", at): "same: no check",
        ("compare", at, "local", "--thorough"): "same: no check",
        ("render", at, swept, "-o", "run.mcap"): "run.mcap",
        ("compare", "baseline", at, "--update"): f"holds the 4 runs of {at}",
        ("compare", "baseline", at): "same: no check",
    }.items():
        code, out, err = contactlab(*arguments)
        assert (code, expected in out) == (0, True), (arguments, out, err)
        assert "contactlab-" not in out + err, "it names the folder that it was fetched to"
    # No configuration of the store is free of failures at each drop height.
    code, out, err = contactlab("tradeoff", at, "--metric", "oracle_error")
    assert (code, "2 configurations" in out, "energy_loss rules out" in err) == (1, True, True)
    assert "contactlab-" not in out + err


@pytest.mark.long
@pytest.mark.usefixtures("swept")
def test_the_same_store_twice(contactlab: Any, at: str) -> None:
    code, _, err = contactlab("compare", at, at)
    assert code == 2
    assert f"{at} and {at} are the same store" in err


@pytest.mark.night
@pytest.mark.usefixtures("swept")
def test_a_report(contactlab: Any, at: str) -> None:
    pytest.importorskip("jinja2", reason="reports are an extra")
    code, out, err = contactlab("report", at, "--baseline", "local", "--traces", "2")
    assert code == 0, err
    assert out.strip() == "one.html"
    page = Path("one.html").read_text(encoding="utf-8")
    assert f"contactlab compare local {at}" in page
    assert "/contactlab-" not in page, "it names the folder that it was fetched to"


@pytest.mark.long
def test_a_sweep_speaks_of_its_address(contactlab: Any, small: Path, at: str) -> None:
    asked = ("sweep", str(small), "--workers", "0", "-o")
    code, out, err = contactlab(*asked, at, "--format", "json")
    assert code == 0, err
    assert json.loads(out)["store"] == at
    again = contactlab(*asked, at)
    assert again.code == 0
    assert f"look closer: contactlab show {at} " in again.out


@pytest.mark.long
def test_refused_in_one_message(contactlab: Any, small: Path, at: str, connect: Any) -> None:
    address = parse_address(at)
    assert isinstance(address, ObjectAddress)
    connect(address).put_file("thesis.tex", b"dear")
    for target, code, said in (
        (at, 2, f"error: {at} holds other files (thesis.tex); choose another place with -o"),
        ("s3://no-such-bucket/a", 2, "there is no bucket s3://no-such-bucket"),
        ("s3://only-a-bucket", 2, "write s3://BUCKET/PREFIX"),
    ):
        result = contactlab("sweep", str(small), "--workers", "0", "-o", target)
        assert (result.code, result.out) == (code, "")
        assert said in result.err.splitlines()[-1]
    for command in ("show", "verify", "report"):
        result = contactlab(command, at)
        assert result.code == 3
        told = "it has no manifest.json; `contactlab sweep` writes one"
        assert result.err == f"error: {at} is not a store: {told}\n"


@pytest.mark.long
@pytest.mark.usefixtures("swept")
def test_an_unfinished_one(contactlab: Any, at: str, connect: Any) -> None:
    address = parse_address(at)
    assert isinstance(address, ObjectAddress)
    connect(address).delete_files(["manifest.json"])
    result = contactlab("show", at)
    assert result.code == 3
    assert f"{at} is unfinished; run its sweep again to resume it" in result.err


@pytest.mark.long
@pytest.mark.parametrize(
    "command", [("stability",), ("examine", "ball_drop"), ("effects", "ball_drop")]
)
def test_commands_that_write_folders_only(contactlab: Any, command: tuple[str, ...]) -> None:
    result = contactlab(*command, "-o", "s3://bucket/a")
    assert result.code == 2
    assert "s3://bucket/a: this command writes into a folder" in result.err
    assert not Path("s3:").exists()
