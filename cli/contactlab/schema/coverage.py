"""Coverage of a run: the joints, actuators, tendons, equalities and pairs that it exercised.

Parts that no run exercised lead to no conclusion.
"""

import json
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass
from typing import Annotated, Any, Literal, get_args

from pydantic import AfterValidator

from contactlab.schema.strict_model import Model, about

Feature = Literal[
    "contact",
    "friction",
    "spin",
    "rolling",
    "motion",
    "limit",
    "tendon",
    "equality",
    "actuation",
    "clamping",
]
"""Features of a model that a run may exercise."""

Short = Annotated[float, AfterValidator(lambda value: float(f"{min(value, 1e300):.4g}"))]
"""A number to four digits, which is as much as coverage is read for.

Runs that diverged have numbers at the limit: the largest there is would round to infinity.
"""
End = Literal["lower", "upper"]

_RUBBED = 1e-3
"""Least ratio of a tangential force that counts to the normal force; rounding takes less."""

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


class Travel(Model):
    """Share of its range that a joint, a tendon or a control went through."""

    moved: Short = about(
        "Greatest less least value; of free joints the diagonal of the box "
        "that their path fills [m], of ball joints the largest angle from it [rad].",
        default=0.0,
    )
    share: Short | None = about("The same over its range, if limited.", default=None)
    ends: tuple[End, ...] = about("Limits that acted, or that a control went beyond.", default=())
    turned: Short | None = about(
        "Largest angle of a free joint from its start [rad].", default=None
    )
    stretched: Short | None = about(
        "Largest distance of a tendon's length from the slack range of its spring.", default=None
    )

    @property
    def counts(self) -> bool:
        """True if it moved by more than holding still takes."""
        share = self.moved if self.share is None else self.share
        # Least motion that counts: 1 % of a range, or 0.01 m or rad; holding still takes less.
        moved = 0.01
        return max(share, self.turned or 0.0) >= moved


class ActuatorUse(Travel):
    """Share of its range that an actuator's control went through, and its force."""

    force: Short = about("Largest force, as the actuator has it.", default=0.0)
    saturated: Short = about("Share of time at a limit of its force.", default=0.0)


class PairUse(Model):
    """Contact, slip, rolling and spin of a monitored pair, each as a share of time."""

    touched: Short = about("It bore a force.", default=0.0)
    stuck: Short = about("It touched, or hopped, without sliding.", default=0.0)
    slid: Short = about("It slid.", default=0.0)
    rolled: Short = about("It stuck, and turned about a tangent.", default=0.0)
    spun: Short = about("It turned about the normal.", default=0.0)
    friction: Short = about("Largest tangential over the largest normal force.", default=0.0)


class Coverage(Model):
    """Parts of a model that moved, were loaded, or touched in a run."""

    joints: dict[str, Travel] = about("Every joint.", default_factory=dict)
    tendons: dict[str, Travel] = about("Every tendon.", default_factory=dict)
    actuators: dict[str, ActuatorUse] = about("Every actuator.", default_factory=dict)
    equalities: dict[str, Short] = about(
        "Largest force of each equality at sampled steps [N or N m]; 0 below 1e-4 of "
        "the model's weight.",
        default_factory=dict,
    )
    pairs: dict[str, PairUse] = about(
        "The monitored pairs that touched; no others did.", default_factory=dict
    )
    touched: Short = about("Share of time with any contact in the model.", default=0.0)

    @property
    def present(self) -> frozenset[Feature]:
        """The features with parts in the model, except contacts."""
        parts = {**self.joints, **self.tendons}.values()
        holds: dict[Feature, bool] = {
            "motion": bool(self.joints),
            "limit": any(part.share is not None for part in parts),
            "tendon": bool(self.tendons),
            "equality": bool(self.equalities),
            "actuation": bool(self.actuators),
        }
        return frozenset(feature for feature, is_present in holds.items() if is_present)

    @property
    def exercised(self) -> frozenset[Feature]:
        """The features of the model that the run exercised."""
        parts = [*self.joints.values(), *self.tendons.values()]
        limited = [part for part in parts if part.share is not None]
        uses = self.pairs.values()
        # Pairs that are not monitored are only known to have touched.
        unknown = self.touched > 0 and not uses
        holds: dict[Feature, bool] = {
            "contact": self.touched > 0,
            "friction": unknown or any(use.slid or use.friction >= _RUBBED for use in uses),
            "spin": unknown or any(use.spun for use in uses),
            "rolling": unknown or any(use.rolled for use in uses),
            "motion": any(joint.counts for joint in self.joints.values()),
            # One effect is about all parts of a kind, so that each of them must have its turn. A
            # limit stops nothing if a joint only starts or rests there.
            "limit": all(part.ends and part.counts for part in limited),
            "tendon": all(tendon.counts or tendon.stretched for tendon in self.tendons.values()),
            "equality": all(self.equalities.values()),
            "actuation": any(actuator.force for actuator in self.actuators.values()),
            "clamping": any(actuator.ends for actuator in self.actuators.values()),
        }
        return frozenset(feature for feature, is_exercised in holds.items() if is_exercised)


def _unite_values(one: Any, other: Any) -> Any:  # noqa: ANN401 - JSON
    """Return the larger of two numbers, all of two lists, and of tables this for each entry."""
    if isinstance(one, dict) and isinstance(other, dict):
        return {key: _unite_values(one.get(key), other.get(key)) for key in {**one, **other}}
    if isinstance(one, list) and isinstance(other, list):
        return sorted({*one, *other})
    return other if one is None else one if other is None else max(one, other)


def feature_of(setting: str) -> Feature | None:
    """Return the feature that runs must exercise to show the effect of a setting, if known."""
    return next(
        (feature for start, feature in _FEATURES.items() if setting.startswith(start)), None
    )


@dataclass(frozen=True)
class ExercisedFeatures:
    """Features that some runs exercised, and their drives; all features if unknown.

    The present ones have parts in the model.
    """

    features: frozenset[Feature]
    present: frozenset[Feature]
    drives: tuple[object, ...]
    coverage: Coverage | None = None  # of all runs together; None where that of one is not known
    pairs: tuple[str, ...] = ()  # the monitored pairs

    @classmethod
    def of_rows(
        cls, rows: Iterable[Mapping[str, Any]], enough: Collection[Feature] | None = None
    ) -> "ExercisedFeatures":
        """Return the features that the runs of a table's rows exercised, each part in any of them.

        Once these are features enough, no more rows are read.
        """
        features: set[Feature] = set()
        coverage: dict[str, Any] = {}
        drives: list[object] = []
        pairs: dict[str, object] = {}
        is_proven = True
        for row in rows:
            if enough is not None and features.issuperset(enough):
                break
            drives.append(json.loads(row.get("drive") or '"none"'))
            own = row.get("pairs")
            pairs |= json.loads(own) if isinstance(own, str) else dict(own or {})
            if row.get("coverage") is None:
                is_proven = False
                features.update(get_args(Feature))
                continue
            features.update(Coverage.model_validate_json(row["coverage"]).exercised)
            coverage = _unite_values(coverage, json.loads(row["coverage"]))
        whole = Coverage.model_validate(coverage)
        proven = whole if is_proven and drives else None
        return cls(whole.exercised | features, whole.present, tuple(drives), proven, tuple(pairs))

    def idle_parts(self) -> tuple[str, ...]:
        """Return the parts that no run exercised, a line for each kind; empty if not known."""
        if self.coverage is None:
            return ()
        whole, pairs = self.coverage, self.coverage.pairs
        limited = {**whole.joints, **whole.tendons}.items()
        kinds = {
            "joints never moved": [name for name, use in whole.joints.items() if not use.counts],
            "limits never reached": [
                name for name, use in limited if use.share is not None and not use.ends
            ],
            "tendons never moved": [
                name for name, use in whole.tendons.items() if not (use.counts or use.stretched)
            ],
            "actuators never moved": [
                name for name, use in whole.actuators.items() if not use.counts
            ],
            "equalities never loaded": [
                name for name, load in whole.equalities.items() if not load
            ],
            "pairs never touched": [name for name in self.pairs if name not in pairs],
            "friction never loaded": [
                name for name, use in pairs.items() if not use.slid and use.friction < _RUBBED
            ],
        }
        return tuple(f"{kind}: {', '.join(names)}" for kind, names in kinds.items() if names)

    def describe_lacking(self, features: Collection[Feature]) -> str | None:
        """Say which features no run exercised; None if all were."""
        lacking = {
            feature: phrase
            for feature, phrase in _LACKING.items()
            if feature in features and feature not in self.features
        }
        return ", ".join(lacking.values()) or None
