"""Pages and tables call geoms without a name by their bodies; the store keeps their addresses."""

import sys
from pathlib import Path

import pytest

import contactlab
from contactlab.command_line.main import main
from contactlab.page.script_data import packed_series
from contactlab.run.geom_naming import geom_replacers

MODEL = """<mujoco><worldbody>
  <geom type="plane" size="3 3 .1"/>
  <body name="foot" pos="0 0 .1"><freejoint/>
    <geom size=".05"/><geom size=".05" pos=".2 0 0"/></body>
  <body pos="0 .5 .1"><freejoint/><geom size=".05"/></body>
  <body name="puck" pos="0 1 .1"><freejoint/><geom name="rim" size=".05"/></body>
</worldbody></mujoco>"""


def test_unnamed_geoms_are_called_by_their_bodies(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "model.xml").write_text(MODEL)
    sweep = {"version": 1, "scene": str(tmp_path / "model.xml"), "duration": 0.01, "checks": "none"}
    store = contactlab.sweep(sweep, output=tmp_path / "store", workers=0)
    records = {0: store.record_at(0)}
    told = geom_replacers(store, records)
    pairs = {name: told[0](name) for name in records[0].pairs}
    assert pairs["geom[0]-geom[1]"] == "world-foot geom[1]"
    assert pairs["geom[0]-geom[3]"] == "world-body[2]"
    assert pairs["geom[0]-rim"] == "world-rim"
    assert len({*pairs.values()}) == len(pairs) == 9
    drawn = packed_series(store, records, told)["runs"][0]
    assert {name for name, _ in drawn["bands"]} == {*pairs.values()}
    assert {"foot z", "body[2] z", "puck z"} <= {name for name, *_ in drawn["signals"]}
    command = ["contactlab", "show", str(store.address), records[0].run_id]
    monkeypatch.setattr(sys, "argv", command)
    with pytest.raises(SystemExit):
        main()
    shown = capsys.readouterr().out
    assert {"world-body[2]", "world-rim"} <= {word.rstrip(",") for word in shown.split()}
    assert "geom[0]" not in shown
