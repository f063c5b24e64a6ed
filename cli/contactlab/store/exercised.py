"""What the runs of a store exercised, so that nothing is concluded from what none of them did."""

import json
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass
from typing import Any, get_args

from contactlab.schema.coverage import Coverage, Feature

_LACKING: Mapping[Feature, str] = {
    "contact": "nothing touched",
    "friction": "nothing rubbed in a contact",
    "spin": "nothing spun in a contact",
    "rolling": "nothing rolled",
    "motion": "no joint moved",
    "limit": "not every joint and tendon moved into its limit",
    "tendon": "not every tendon moved or was stretched",
    "equality": "not every equality bore a load",
    "actuation": "no actuator exerted a force",
    "clamping": "no control left its range",
}
# By how the names of settings begin; the first that fits counts.
_FEATURES: Mapping[str, Feature] = {
    "friction.torsion": "spin",
    "friction.roll": "rolling",
    "dof_frictionloss": "motion",
    "dof_damping": "motion",
    "tendon_": "tendon",
    **dict.fromkeys(("friction", "condim", "cone", "impratio", "noslip"), "friction"),
    **dict.fromkeys(("solref", "solimp", "margin", "gap", "ccd_"), "contact"),
}


def feature_of(setting: str) -> Feature | None:
    """Return the feature that runs must exercise to show what a setting does, if it is known."""
    return next((each for start, each in _FEATURES.items() if setting.startswith(start)), None)


@dataclass(frozen=True)
class Exercised:
    """What some runs exercised.

    Attributes:
        features: of the model; all of them where that is not known of a run.
        present: features of which the model has parts.
        drives: what drove the runs.
    """

    features: frozenset[Feature]
    present: frozenset[Feature]
    drives: tuple[object, ...]

    @classmethod
    def of(cls, rows: Iterable[Mapping[str, Any]]) -> "Exercised":
        """Return what the runs of some rows of a table exercised."""
        features: set[Feature] = set()
        present: set[Feature] = set()
        drives: list[object] = []
        for row in rows:
            drives.append(json.loads(row.get("drive") or '"none"'))
            if row.get("coverage") is None:
                features.update(get_args(Feature))
                continue
            coverage = Coverage.model_validate_json(row["coverage"])
            features.update(coverage.exercised)
            present.update(coverage.present)
        return cls(frozenset(features), frozenset(present), tuple(drives))

    def lack(self, features: Collection[Feature]) -> str | None:
        """Say which features no run exercised, and name the drive that would; None if one did."""
        lacking = {
            each: said
            for each, said in _LACKING.items()
            if each in features and each not in self.features
        }
        if not lacking:
            return None
        # Exercises stay within the ranges of controls.
        tried = "exercise" in self.drives or lacking.keys() == {"clamping"}
        better = "{file: FILE}, of controls that do it" if tried else "exercise"
        return f"{', '.join(lacking.values())}; write drive: {better}"
