"""Compare the advice of a quiet machine and one worker with that of a busy machine and two.

Run: python -m bench.repeated_advice FOLDER MODEL ...

Each command that recommends runs twice for each model: with `--workers 1`, and with two workers
next to four busy loops, which end with the command. Reports without their times, and written
files byte by byte, have to be equal. The folder keeps the files of both runs.
"""

import json
import re
import subprocess
import sys
from collections.abc import Generator, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

Json = dict[str, "Json"] | list["Json"] | str | float | bool | None
_COMMAND = str(Path(sys.executable).with_name("contactlab"))
_COMPARED = {".json", ".xml", ".urdf", ".patch", ".diff"}


@dataclass(frozen=True)
class Protocol:
    """The conditions of a comparison.

    Attributes:
        loops: busy loops next to the second run.
        busy_seconds: after which a busy loop ends in any case.
        search_time: limit of a search: short, and long enough that only counted work ends it.
        times: keys of reports whose values are measured times, or depend on them.
    """

    loops: int = 4
    busy_seconds: float = 1800.0
    search_time: str = "40s"
    times: re.Pattern[str] = re.compile(
        r"(^|_)(seconds|time_ratio|noise_floor|real_time|speed|cpu|wall|created|date)(_|$)"
    )


PROTOCOL = Protocol()


def list_commands(model: str, folder: Path) -> dict[str, list[str]]:
    """Return the words of each command that recommends, without the number of workers."""
    name, limit = Path(model).name, ["--max-cpu", PROTOCOL.search_time]
    return {
        "lint": ["lint", model, "--format", "json"],
        "examine": ["examine", model, "-o", str(folder / "examine"), "--write",
                    str(folder / "fixed" / name)],
        "tune": ["tune", model, "-o", str(folder / "tune"), *limit],
        "effects": ["effects", model, "-o", str(folder / "effects"), "--write",
                    str(folder / "smaller" / name), *limit],
        "grip": ["grip", model, "-o", str(folder / "grip.json")],
    }  # fmt: skip


@contextmanager
def keep_busy(loops: int) -> Generator[None]:
    """Run busy loops until the end of the block, or for a bounded time."""
    code = f"import time\nend = time.time() + {PROTOCOL.busy_seconds}\nwhile time.time() < end: 0"
    running = [subprocess.Popen([sys.executable, "-c", code]) for _ in range(loops)]
    try:
        yield
    finally:
        for process in running:
            process.kill()
            process.wait()


def run_command(words: Sequence[str], workers: int, folder: Path) -> str:
    """Run a command; return its exit code, and its output if that is its report."""
    folder.mkdir(parents=True, exist_ok=True)
    is_lint = words[0] == "lint"
    count = [] if is_lint or words[0] == "grip" else ["--workers", str(workers)]
    done = subprocess.run([_COMMAND, *words, *count], capture_output=True, text=True, check=False)
    (folder / f"{words[0]}.txt").write_text(done.stdout + done.stderr)
    return f"exit {done.returncode}\n{done.stdout if is_lint else ''}"


def list_values(value: Json, place: str) -> Iterator[tuple[str, str]]:
    """Yield each value of a JSON document that is no measured time, with its place."""
    if isinstance(value, dict):
        for key, entry in value.items():
            if not PROTOCOL.times.search(key):
                yield from list_values(entry, f"{place}/{key}")
    elif isinstance(value, list):
        for number, entry in enumerate(value):
            # Rows with a name may have the order of their times.
            own = entry.get("name", number) if isinstance(entry, dict) else number
            yield from list_values(entry, f"{place}[{own}]")
    else:
        # A sentence has measured ratios and speeds, such as "x0.91 (0.90 to 0.92) time", and says
        # where the interval is too wide to show the saving of counted work.
        work = r"(x[\d.]+ work, )?"
        times = (
            rf"same speed \(x[\d.]+ time\)|{work}x[\d.]+ (\([^)]*\) )?(of the )?time"
            r"(, which is within noise)?|[\d.]+x real time"
        )
        # A ratio near 1 is shown as an equal speed, so that both forms count as the same.
        yield place, re.sub(times, "TIME", str(value))


def read_run(folder: Path) -> dict[str, str]:
    """Return the compared contents of a run, by file and place in it."""
    found = dict[str, str]()
    for path in sorted(folder.rglob("*")):
        # The manifest of a store has the time of its runs, and hashes of files that have it.
        if path.is_file() and path.suffix in _COMPARED and path.name != "manifest.json":
            place = str(path.relative_to(folder))
            text = path.read_text().replace(str(folder), "FOLDER")
            if path.suffix == ".json":
                found.update(list_values(json.loads(text), place))
            else:
                found[place] = text
    return found


def compare_model(model: str, folder: Path) -> bool:
    """Run all commands on a model in both conditions; return whether all results are equal."""
    runs = list[dict[str, str]]()
    for name, workers, loops in (("quiet", 1, 0), ("busy", 2, PROTOCOL.loops)):
        own = folder / Path(model).stem / name
        with keep_busy(loops):
            said = {
                f"contactlab {command}": run_command(words, workers, own)
                for command, words in list_commands(model, own).items()
            }
        runs.append(said | read_run(own))
    first, second = runs
    different = [key for key in sorted({*first, *second}) if first.get(key) != second.get(key)]
    print(f"{'differs' if different else 'equal  '} {model}: {len(first)} values", flush=True)
    for key in different[:10]:
        print(f"      {key}: {first.get(key, '-')[:80]} | {second.get(key, '-')[:80]}", flush=True)
    return not different


def main(words: Sequence[str]) -> None:
    """Compare models, and print how many have equal advice."""
    folder, *models = words
    equal = [compare_model(model, Path(folder).resolve()) for model in models]
    print(f"{sum(equal)} of {len(equal)} have the same advice in both conditions")
    raise SystemExit(not all(equal))


if __name__ == "__main__":
    main(sys.argv[1:])
