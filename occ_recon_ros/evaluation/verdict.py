"""Whether a result may be believed: good, doubtful or failed, why, and what to do.

A body can be watertight and wrong: it was carved from outlines of something else. What tells:
outlines that contradict each other, outlines of the image instead of an object, images of
which nothing came, a body that its own outlines refute.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from occ_recon_ros.geometry import Contours
from occ_recon_ros.geometry.arrays import Array
from occ_recon_ros.surface.agreement import Agreement, silhouette_agreement

from . import findings
from .advice import BARE, explains_all
from .base import Base, base_under
from .evidence import Evidence
from .findings import DOUBTFUL, FAILED, GOOD, Finding


@dataclass(frozen=True)
class Verdict:
    """What is to be thought of a result.

    Attributes:
        word: good, doubtful or failed.
        reasons: sentences, the gravest first; empty if it is good.
        advice: what to do, in the order to try it.
        doubtful_views: numbers, from 0, of views that contradict the others.
        agreement: of all views with each other; None if it could not be told.
        base: something flat that turns with the object and was taken for a part of it.
        notes: sentences on what outlines cannot tell of a body that fits them well.
    """

    word: str
    reasons: tuple[str, ...]
    advice: tuple[str, ...]
    doubtful_views: tuple[int, ...] = ()
    agreement: Agreement | None = None
    base: Base | None = None
    notes: tuple[str, ...] = ()

    @property
    def shares(self) -> Array:
        """(n,) by how much each view contradicts the others, 0 to 1; empty if it could not be
        told."""
        return self.agreement.share if self.agreement else np.zeros(0)

    def report(self) -> dict[str, object]:
        """As report.json holds it."""
        return {
            "word": self.word,
            "reasons": list(self.reasons),
            "advice": list(self.advice),
            "notes": list(self.notes),
            "doubtful_views": list(self.doubtful_views),
            "view_disagreement": [float(share) for share in self.shares],
        }


def judge(evidence: Evidence) -> Verdict:
    """Weigh the evidence. The gravest finding decides."""
    agreement = evidence.agreement or _agreement(evidence.contours)
    base = None if evidence.bounded else base_under(evidence.contours)
    ends = findings.of_ends(evidence)
    found = [
        *findings.of_number(evidence),
        *findings.of_agreement(evidence, agreement),
        *findings.of_covering(evidence, agreement),
        *findings.of_border(evidence),
        *findings.of_views(evidence, agreement),
        *findings.of_sharpness(evidence),
        *findings.of_body(evidence),
        *ends,
        # Whether it is the object at all goes before how much of it was seen.
        *findings.of_remarks(evidence),
        *findings.of_turn(evidence),
        *_of_base(base),
    ]
    notes = [*evidence.notes, *findings.few_strips(evidence), *findings.sparse(evidence)]
    rows = [*ends, *(row for row in found if row not in ends)]
    notes += ["; ".join(filter(None, row[1:])) for row in rows if row.grade == GOOD]
    found = sorted((row for row in found if row.grade != GOOD), key=lambda row: row.grade != FAILED)
    word = found[0].grade if found else GOOD
    first = [row._replace(grade=word) for row in found if explains_all(row.what)]
    found = first + [row for row in found if not explains_all(row.what)]
    doubtful = np.flatnonzero(agreement.doubtful) if agreement else np.zeros(0, np.intp)
    return Verdict(
        word,
        tuple(row.what for row in found),
        # Where it failed, what is only doubtful is most likely a consequence.
        tuple(dict.fromkeys(row.advice for row in found if row.grade == word)),
        tuple((doubtful * evidence.every).tolist()),
        agreement,
        base,
        tuple(notes) if word != FAILED else (),
    )


def _of_base(base: Base | None) -> list[Finding]:
    """Something flat that turns with the object and was taken for a part of it."""
    if base is None:
        return []
    what = "if it is not of the object, leave it out" if not base.bare else BARE
    return [Finding(DOUBTFUL, base.said(), f"{what}: --segment joint {base.options()}")]


def _agreement(contours: Sequence[Contours]) -> Agreement | None:
    try:
        return silhouette_agreement(contours)
    except (ValueError, np.linalg.LinAlgError):
        return None
