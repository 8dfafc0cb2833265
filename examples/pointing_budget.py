# A pointing budget: this drive and a reaction wheel against requirements, and what costs most.
from pathlib import Path

import microvib as mv

here = Path(__file__).parent
budget = mv.pointing_budget(
    mv.load_scenario(here / "spacecraft.yaml"), here / "requirement.yaml", sources=here / "sources.yaml", steady=True
)
for one in budget.judged:
    print(f"{one.requirement.name}: {one.value:.3g} rad of {one.limit:.3g} rad, {one.verdict}")
top = budget.judged[0].ranking[0]
print(f"P-1: {100 * top.share:.0f} % from {top.line} of {top.source}")
