"""What a budget of runs or hours kept from being done, and what more of it would buy."""

from __future__ import annotations

from aleator.results.values import Diagnostic
from aleator.simulators import Account
from aleator.surrogates import AdaptiveSurfaces
from aleator.surrogates.outlook import Outlook, outlook

ABOUT = "budget"
UNCHECKED = Diagnostic(
    ABOUT,
    "the budget had no runs left to check the answer on the simulator itself",
    "allow more runs, or hours, and give the same command again: the runs are kept",
)


def budget_warnings(
    account: Account,
    surfaces: AdaptiveSurfaces | None,
    against: str = "the outcome's scatter",
) -> list[Diagnostic]:
    """That the surfaces had fewer runs than they asked for; what is left of the error, and why.

    `against` is what their errors are judged by.
    """
    if surfaces is None or not account.refused:
        return []
    found = outlook(surfaces)
    if not found.rough:
        return []
    return [
        Diagnostic(
            ABOUT,
            f"the budget of {account.budget} ended the runs of the response surfaces: of "
            f"{found.rough} of {found.surfaces} the estimated error is above {found.level:.0%} of "
            f"{against}, at most {found.worst:.0%}",
            f"give the same command again, the runs are kept: {_bought(found)}",
        )
    ]


def _bought(found: Outlook) -> str:
    if found.needed is None or found.then is None:
        return "how fast the errors fall is known after one more round"
    text = f"about {found.needed:,} more would do, as the errors fell so far"
    if found.needed > found.more:
        text += f", and {found.more:,} more would bring the largest to {found.then:.0%}"
    return text
