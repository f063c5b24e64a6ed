"""The process of an engine: `python serve.py ADAPTER.py`, in the environment that has the engine.

It reads requests from its input and answers on what was its output, both pickled: None whenever
part of the work is done, and in the end a dictionary of arrays, or a sentence that says what went
wrong. It knows nothing of contactlab, and ends with the process that started it.
"""

import importlib.util
import os
import pickle
import sys

answers = os.fdopen(os.dup(1), "wb")
os.dup2(2, 1)  # what an engine prints is no answer


def answer(value: object) -> None:
    """Send an answer."""
    pickle.dump(value, answers, protocol=5)
    answers.flush()


def main(adapter: str) -> None:
    """Simulate what is asked until the input ends."""
    spec = importlib.util.spec_from_file_location("adapter", adapter)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    while True:
        try:
            request = pickle.load(sys.stdin.buffer)  # noqa: S301 - from the process that started it
        except EOFError:
            return
        try:
            answer(module.simulate(request, lambda: answer(None)))
        except BrokenPipeError:
            return
        except Exception as error:  # noqa: BLE001 - told where it is known which runs it was
            answer(f"{type(error).__name__}: {' '.join(str(error).split())}")


if __name__ == "__main__":
    main(sys.argv[1])
