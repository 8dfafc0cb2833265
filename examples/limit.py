# Pass or fail: every line against a limit, each by what it is known to.
import microvib as mv

scenario = mv.load_scenario("state-1")
table = mv.find_lines(scenario, start="steady")

for limit in (mv.Limit("60 mN*m"), mv.Limit("40 mN*m"), mv.Limit("40 mN*m", "60 Hz", "150 Hz")):
    print(mv.judge(table, limit, scenario))
