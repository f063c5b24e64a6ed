"""What the runs of a study exercised, so that it says nothing of what none of them did."""

import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, get_args

from contactlab.schema.coverage import Coverage, Feature

_LACKING: Mapping[Feature, str] = {
    "contact": "nothing touched",
    "friction": "nothing rubbed in a contact",
    "spin": "nothing spun in a contact",
    "rolling": "nothing rolled",
    "motion": "no joint moved",
    "limit": "no joint or tendon moved into its limit",
    "tendon": "no tendon moved or was stretched",
    "equality": "no equality bore a load",
    "actuation": "no actuator exerted a force",
    "clamping": "no control left its range",
}


@dataclass(frozen=True)
class Exercised:
    """What some runs exercised.

    Attributes:
        features: of the model, all of them where that is not known of a run.
        drives: what drove the runs.
    """

    features: frozenset[str]
    drives: tuple[object, ...]

    @classmethod
    def of(cls, rows: Iterable[Mapping[str, Any]]) -> "Exercised":
        """Return what the runs of some rows of a table exercised."""
        features: set[str] = set()
        drives: list[object] = []
        for row in rows:
            text = row["coverage"]
            known = Coverage.model_validate_json(text).exercised if text else get_args(Feature)
            features.update(known)
            drives.append(json.loads(row["drive"]))
        return cls(frozenset(features), tuple(drives))

    def lack(self, feature: Feature | None) -> str | None:
        """Say why a feature was not exercised, and name the drive that would; None if it was."""
        if feature is None or feature in self.features:
            return None
        # Exercises stay within the ranges of controls.
        tried = "exercise" in self.drives or feature == "clamping"
        better = "{file: FILE}, of controls that do it" if tried else "exercise"
        return f"{_LACKING[feature]}; write drive: {better}"
