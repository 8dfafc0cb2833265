# A scenario never changes: `with_` makes a changed copy, and says what it does not understand.
import microvib as mv

scenario = mv.load_scenario("state-1")
stiffer = scenario.with_({"reducer.stiffness": "9000 N*m/rad", "tracking.rate": "0.05 deg/s"})
print(scenario["reducer.stiffness"], "->", stiffer["reducer.stiffness"], "N m/rad")

for changes in ({"reducer.stifness": "9000 N*m/rad"}, {"tracking.rate": 0.05}, {"tracking.rate": "0.05 Hz"}):
    try:
        scenario.with_(changes)
    except mv.ScenarioError as error:
        print(error)

slow = scenario.with_si({"tracking.rate": 0.001})
print(f"{slow['tracking.rate']} rad/s: programs that compute in SI say so")
