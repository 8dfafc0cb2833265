# A pointing budget: this drive and a reaction wheel against requirements, and the largest contributors.
from pathlib import Path

import microvib as mv

here = Path(__file__).parent
budget = mv.pointing_budget(
    here / "spacecraft.yaml", here / "requirement.yaml", sources=here / "sources.yaml", steady=True
)
for one in budget.judged:
    print(f"{one.requirement.name}: {one.value:.3g} rad of {one.limit:.3g} rad, {one.verdict}")
largest = budget.judged[0].ranking[0]
print(f"P-1: {100 * largest.share:.0f} % from {largest.line} of {largest.source}")
