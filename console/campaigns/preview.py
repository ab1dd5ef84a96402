"""The paper's figures and claims of a campaign that is not finished, from the results that there are.

    python -m console.campaigns.preview CAMPAIGN_FOLDER

A process of its own, which draws into the folder's preview. A campaign without the paper's controllers has none.
"""

import json
import sys
from pathlib import Path

from console.campaigns.folder import CLAIMS, CampaignFolder
from rtstack.campaign.claims import judge_claims
from rtstack.campaign.evaluation import FIGURE11, Evaluation
from rtstack.campaign.figures import figure11

_ALL = 1_000_000
_NEEDED = {"experiment", "conditions", "controller", "displacement_mm", "success", "average_force_norm", "max_lift_mm"}


def main() -> None:
    """Draw; each file is replaced when it is whole, since a page may read it now."""
    folder = CampaignFolder(Path(sys.argv[1]))
    columns, rows = folder.rows(_ALL)
    if not set(columns) >= _NEEDED:
        return
    new = folder.preview / "new"
    new.mkdir(parents=True, exist_ok=True)
    parts = []
    for conditions in sorted({row["conditions"] for row in rows}):
        evaluation = Evaluation(rows, conditions)
        claims = [
            {"where": c.where, "claim": c.says, "verdict": str(c.verdict), "figures": c.ours}
            for c in judge_claims(evaluation)
        ]
        parts.append({"name": conditions, "claims": claims})
        if evaluation.of(FIGURE11):
            figure11(new / f"figure11-{conditions}.png", evaluation)
    (new / CLAIMS).write_text(json.dumps({"conditions": parts}), encoding="utf-8")
    for drawn in new.iterdir():
        drawn.replace(folder.preview / drawn.name)


if __name__ == "__main__":
    main()
