"""The part of the page that runs in a browser: built from `live/` by `make live`."""

import json
from dataclasses import dataclass
from pathlib import Path

from contactlab.errors import OutputError

_BUILD_FOLDER = Path(__file__).parent / "built"


@dataclass(frozen=True)
class BrowserBuild:
    """The script of the page, MuJoCo's WebAssembly under gzip, its version, and licences."""

    script: str
    engine: bytes
    mujoco: str
    licences: tuple[tuple[str, str], ...]  # of each package: its name with version, and the text


def find_build() -> BrowserBuild:
    """Return the build; raise an OutputError with the build command without one."""
    try:
        facts = json.loads((_BUILD_FOLDER / "build.json").read_text(encoding="utf-8"))
        return BrowserBuild(
            script=(_BUILD_FOLDER / "page.js").read_text(encoding="utf-8"),
            engine=(_BUILD_FOLDER / "engine.wasm.gz").read_bytes(),
            mujoco=facts["mujoco"],
            licences=tuple((name, text) for name, text in facts["licences"].items()),
        )
    except FileNotFoundError as error:
        raise OutputError(
            "the browser's part of the page is not built; run `make live` in the checkout, which "
            "takes npm and Node.js 20"
        ) from error
